"""Files of grids for other runtimes, by their ending."""

from pandis.pipeline.kinds.grid.graph import export_grid

EXPORTS = {"onnx": export_grid}

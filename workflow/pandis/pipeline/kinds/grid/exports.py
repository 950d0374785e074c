"""Exporters of grids for other runtimes, by file extension."""

from pandis.pipeline.kinds.grid.graph import export_grid

EXPORTS = {"onnx": export_grid}

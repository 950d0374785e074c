"""Exporters of networks for other runtimes, by file extension."""

from pandis.pipeline.kinds.network.graph import export_network
from pandis.pipeline.kinds.network.program import export_program

EXPORTS = {"onnx": export_network, "pt2": export_program}

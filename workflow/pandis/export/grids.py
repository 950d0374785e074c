"""Export of grid fields: to ONNX, compared with the library before it is written."""

import numpy as np
from onnx import TensorProto

from pandis.export.check import check
from pandis.export.graphs import Graph, enter, leave, split
from pandis.fields.grid import GridField
from pandis.frame import Frame


def grid_graph(artifact, nearest):
    """Return the graph of a grid field.

    Parameters
    ----------
    artifact : pandis.artifact.Artifact
        Of kind ``grid``.
    nearest : bool
        Take the nearest node instead of interpolating trilinearly.

    Returns
    -------
    Graph
    """
    frame = Frame.from_attributes(artifact.attributes["frame"])
    values = artifact.arrays["values"]
    size = len(values)
    graph = Graph()
    table = graph.constant("values", values.reshape(size**3, -1))
    strides = graph.constant("strides", np.array([size * size, size, 1], np.int64))
    clamped, outside = enter(graph, frame)
    shifted = graph.apply("Add", clamped, graph.scalar(1.0, np.float64))
    position = graph.apply("Mul", shifted, graph.scalar((size - 1) / 2, np.float64))

    def node(cell):
        """Look up the values at integer cells (n, 3)."""
        index = graph.apply("Mul", graph.apply("Cast", cell, to=TensorProto.INT64), strides)
        flat = graph.apply(
            "ReduceSum", index, graph.constant(f"axis{len(graph.nodes)}", [1]), keepdims=0
        )
        return graph.apply("Gather", table, flat)

    if nearest:
        half = graph.apply("Add", position, graph.scalar(0.5, np.float64))
        value = node(graph.apply("Floor", half))
    else:
        last = graph.scalar(float(size - 2), np.float64)
        base = graph.apply("Min", graph.apply("Floor", position), last)
        part = graph.apply("Cast", graph.apply("Sub", position, base), to=TensorProto.FLOAT)
        tx, ty, tz = split(graph, part, [1, 1, 1])

        def corner(*offset):
            step = graph.constant("step" + "".join(map(str, offset)), np.array(offset, float))
            return node(graph.apply("Add", base, step))

        def mix(a, b, t):
            return graph.apply("Add", a, graph.apply("Mul", graph.apply("Sub", b, a), t))

        planes = []
        for c in (0, 1):
            lines = [mix(corner(0, b, c), corner(1, b, c), tx) for b in (0, 1)]
            planes.append(mix(*lines, ty))
        value = mix(*planes, tz)
    if artifact.attributes["grid"]["content"] == "force":
        # the vector is the penetration: its length is the depth
        depth = graph.apply("ReduceL2", value, axes=[1], keepdims=0)
        leave(graph, frame, graph.apply("Neg", depth), value)
    else:
        distance = graph.apply("Slice", value, *_columns(graph, 0, 1))
        flat = graph.apply("Squeeze", distance, graph.constant("one", np.array([1], np.int64)))
        vector = graph.apply("Slice", value, *_columns(graph, 1, 4))
        leave(graph, frame, graph.apply("Add", flat, outside), vector)
    return graph


def _columns(graph, start, stop):
    index = len(graph.constants)
    return [
        graph.constant(f"s{index}_{name}", np.array([number], np.int64))
        for name, number in (("start", start), ("stop", stop), ("axis", 1))
    ]


def export_grid(name, artifact, provenance, log):
    """Return the ONNX model of a grid field as bytes.

    Parameters
    ----------
    name : str
        ``nearest-…``, ``trilinear-…`` or ``trilinear-normal-…``.
    artifact : pandis.artifact.Artifact
        Of kind ``grid``.
    provenance : dict
    log : callable

    Raises
    ------
    PandisError
        The model does not answer as the field does.
    """
    nearest = name.startswith("nearest-")
    frame = Frame.from_attributes(artifact.attributes["frame"])
    metadata = {"field": name, "frame": frame.attributes(), "provenance": provenance}
    model = grid_graph(artifact, nearest).model(name, metadata)
    field = GridField(name, artifact, nearest)

    def reference(points):
        return *field.answer(points), np.ones(len(points))

    differences = check(model, reference, frame)
    log(f"agrees with the field: {differences}")
    return model

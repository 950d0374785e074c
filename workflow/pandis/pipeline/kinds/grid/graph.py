"""Exports grid fields to ONNX. Each model is compared with the library before it is written."""

import numpy as np
from onnx import TensorProto

from pandis.pipeline.kinds.check import FORCE_LENGTH, check
from pandis.pipeline.kinds.graphs import Graph, enter, leave, split
from pandis.pipeline.kinds.grid.reference import open_field
from pandis.pipeline.kinds.grid.spec import KIND
from pandis.pipeline.kinds.session import Session
from pandis.pipeline.kinds.tricubic import tricubic


def grid_graph(field):
    """Return the graph of a grid field.

    Parameters
    ----------
    field : pandis.pipeline.kinds.grid.interpolation.GridField

    Returns
    -------
    Graph
    """
    graph = Graph()
    clamped, outside = enter(graph, field.frame, field.axes.low, high=field.axes.high)
    if field.rule == "tricubic":
        distance, gradient = tricubic(graph, field.lattice, field.coefficients, clamped=clamped)
        leave(graph, field.frame, graph.apply("Add", distance, outside), vector=gradient)
        return graph
    if field.rule == "trilinear-gradient":
        distance, gradient = _own_gradient(graph, field, clamped)
        leave(graph, field.frame, graph.apply("Add", distance, outside), vector=gradient)
        return graph
    value = _interpolate(graph, field, field.rule == "nearest", clamped=clamped)
    if field.content == "force":
        # there is no force outside the box; the length of the penetration vector is the depth
        away = graph.apply("Greater", outside, graph.scalar(0.0))
        column = graph.apply("Unsqueeze", away, graph.constant("last", np.array([1], np.int64)))
        value = graph.apply("Where", column, graph.scalar(0.0), value)
        depth = graph.apply("ReduceL2", value, axes=[1], keepdims=0)
        leave(graph, field.frame, graph.apply("Neg", depth), vector=value)
    else:
        distance = graph.apply("Slice", value, *_columns(graph, 0, 1))
        flat = graph.apply("Squeeze", distance, graph.constant("one", np.array([1], np.int64)))
        vector = graph.apply("Slice", value, *_columns(graph, 1, 4))
        leave(graph, field.frame, graph.apply("Add", flat, outside), vector=vector)
    return graph


def _interpolate(graph, field, nearest, *, clamped):
    """Add a lookup of the nearest node or a trilinear interpolation; return the value's name."""
    node, position = _nodes(graph, field, clamped)
    if nearest:
        half = graph.apply("Add", position, graph.scalar(0.5, np.float64))
        return node(graph.apply("Floor", half))
    corner, (tx, ty, tz) = _corners(graph, len(field.values), node, position=position)
    planes = []
    for c in (0, 1):
        lines = [_mix(graph, [corner(a, b, c) for a in (0, 1)], tx) for b in (0, 1)]
        planes.append(_mix(graph, lines, ty))
    return _mix(graph, planes, tz)


def _own_gradient(graph, field, clamped):
    """Add the trilinear interpolation of distances; return it (n,) and its gradient (n, 3)."""
    node, position = _nodes(graph, field, clamped)
    corner, (tx, ty, tz) = _corners(graph, len(field.values), node, position=position)
    c = {offset: corner(*offset) for offset in np.ndindex(2, 2, 2)}
    pairs = [(b, d) for b in (0, 1) for d in (0, 1)]
    line = {(b, d): _mix(graph, (c[0, b, d], c[1, b, d]), tx) for b, d in pairs}
    rise = {(b, d): graph.apply("Sub", c[1, b, d], c[0, b, d]) for b, d in pairs}

    def bilinear(v):
        planes = [_mix(graph, (v[0, d], v[1, d]), ty) for d in (0, 1)]
        return _mix(graph, planes, tz)

    def slope(ends, t):
        return _mix(graph, [graph.apply("Sub", line[b], line[a]) for a, b in ends], t)

    gradient = [
        bilinear(rise),
        slope((((0, 0), (1, 0)), ((0, 1), (1, 1))), tz),
        slope((((0, 0), (0, 1)), ((1, 0), (1, 1))), ty),
    ]
    flat = graph.apply("Squeeze", bilinear(line), graph.constant("one", np.array([1], np.int64)))
    return flat, graph.apply("Concat", *gradient, axis=1)


def _nodes(graph, field, clamped):
    """Return a function from node indices (n, 3) to node values, and the points in node units."""
    size, low = field.axes.size, np.array(field.axes.low)
    table = graph.constant("values", field.values.reshape(size**3, -1))
    strides = graph.constant("strides", np.array([size * size, size, 1], np.int64))
    shifted = graph.apply("Sub", clamped, graph.constant("first", low))
    per_step = (size - 1) / (np.array(field.axes.high) - low)
    position = graph.apply("Mul", shifted, graph.constant("per_step", per_step))

    def node(cell):
        index = graph.apply("Mul", graph.apply("Cast", cell, to=TensorProto.INT64), strides)
        last = graph.constant(f"axis{len(graph.nodes)}", [1])
        return graph.apply("Gather", table, graph.apply("ReduceSum", index, last, keepdims=0))

    return node, position


def _corners(graph, size, node, *, position):
    """Return a function that looks up a corner of each cell, and the positions in the cells."""
    last = graph.scalar(float(size - 2), np.float64)
    base = graph.apply("Min", graph.apply("Floor", position), last)
    part = graph.apply("Cast", graph.apply("Sub", position, base), to=TensorProto.FLOAT)

    def corner(*offset):
        step = graph.constant("step" + "".join(map(str, offset)), np.array(offset, float))
        return node(graph.apply("Add", base, step))

    return corner, split(graph, part, [1, 1, 1])


def _mix(graph, ends, t):
    a, b = ends
    return graph.apply("Add", a, graph.apply("Mul", graph.apply("Sub", b, a), t))


def _columns(graph, start, stop):
    index = len(graph.constants)
    return [
        graph.constant(f"s{index}_{name}", np.array([number], np.int64))
        for name, number in (("start", start), ("stop", stop), ("axis", 1))
    ]


def export_grid(name, artifact, provenance, *, log):
    """Return the ONNX model of a grid field as bytes.

    Parameters
    ----------
    name : str
        ``nearest-…``, ``trilinear-…``, ``trilinear-normal-…`` or ``tricubic-…``.
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``grid``.
    provenance : dict
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The answers of the model differ from the field's.
    """
    field = open_field(KIND.parse(name, None), artifact)
    metadata = {"field": name, **field.frame.attributes(), "provenance": provenance}
    model = grid_graph(field).model(name, metadata)

    def reference(points):
        # a grid's direction may jump between cells, and rounding decides which cell is used,
        # so the force is compared instead of the normal
        length = np.minimum(field.direction_length(points), FORCE_LENGTH)
        return *field.answer(points), length

    answer = Session(model).distance_and_normal
    # a direction from differences between nodes loses more digits the closer the nodes are
    rounding = max(1.0, len(field.values) / 32) if field.content == "distance" else 1.0
    differences = check(answer, reference, field.frame, rounding=rounding)
    log(f"agrees with the field: {differences}")
    return model

"""Tricubic B-splines in exported fields: in ONNX graphs, and in torch."""

import numpy as np
from onnx import TensorProto

from pandis.engine.spline import EDGE
from pandis.pipeline.kinds.graphs import split

#: Offsets of the 64 nodes around a cell.
AROUND = np.stack(np.meshgrid(*[np.arange(-1, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
#: BASIS: coefficients (power, node) of the polynomials in the cell position that weight an axis's
#: four nodes. SLOPE: those of their derivatives.
BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6
SLOPE = np.vstack([BASIS[1:] * [[1], [2], [3]], np.zeros(4)])


def tricubic(graph, lattice, coefficients, *, clamped):
    """Add a tricubic B-spline to a graph.

    Parameters
    ----------
    graph : pandis.pipeline.kinds.graphs.Graph
    lattice : pandis.engine.spline.Lattice
    coefficients : ndarray, shape (lattice.size,) * 3, float32
    clamped : str
        Name of the points, float64 (n, 3), in the box [-1, 1]³.

    Returns
    -------
    str, str
        The names of value (n,) and gradient (n, 3).
    """
    size, double = lattice.size, np.float64
    table = graph.constant("coefficients", coefficients.reshape(-1))
    within = graph.apply("Clip", clamped, graph.scalar(-EDGE, double), graph.scalar(EDGE, double))
    shifted = graph.apply("Sub", within, graph.scalar(lattice.low, double))
    position = graph.apply("Mul", shifted, graph.scalar(lattice.per_step, double))
    cell = graph.apply("Floor", position)
    t = graph.apply("Cast", graph.apply("Sub", position, cell), to=TensorProto.FLOAT)
    # the 64 nodes around the cell
    strides = graph.constant("strides", np.array([size * size, size, 1], np.int64))
    index = graph.apply("Mul", graph.apply("Cast", cell, to=TensorProto.INT64), strides)
    first = graph.apply("ReduceSum", index, graph.constant("last", [1]), keepdims=1)
    steps = graph.constant("around", (AROUND @ [size * size, size, 1])[None])
    nodes = graph.apply("Gather", table, graph.apply("Add", first, steps))
    cube = graph.apply("Reshape", nodes, graph.constant("cube", np.array([-1, 4, 4, 4])))
    # weights (n, 3, 4) of the four nodes per axis, and their derivatives
    column = graph.apply("Unsqueeze", t, graph.constant("two", np.array([2])))
    one = graph.apply("Add", graph.apply("Mul", column, graph.scalar(0.0)), graph.scalar(1.0))
    square = graph.apply("Mul", column, column)
    third = graph.apply("Mul", square, column)
    powers = graph.apply("Concat", one, column, square, third, axis=2)
    axes = []
    for name, matrix in (("basis", BASIS), ("slope", SLOPE * lattice.per_step)):
        weights = graph.apply("MatMul", powers, graph.constant(name, matrix.astype(np.float32)))
        axes.append(split(graph, weights, [1, 1, 1], prefix=name))

    def contract(value, weights, shape):
        """Sum (n, …, 4) over the last axis, weighted by (n, 1, 4)."""
        name = f"shape{len(graph.constants)}"
        spread = graph.apply("Reshape", weights, graph.constant(name, np.array(shape)))
        product = graph.apply("Mul", value, spread)
        last = graph.constant(f"axis{len(graph.constants)}", [len(shape) - 1])
        return graph.apply("ReduceSum", product, last, keepdims=0)

    (wx, wy, wz), (dx, dy, dz) = axes
    flat, rise = (contract(cube, w, [-1, 1, 1, 4]) for w in (wz, dz))
    line, turn, lift = (contract(v, w, [-1, 1, 4]) for v, w in ((flat, wy), (flat, dy), (rise, wy)))
    value, gx, gy, gz = (
        contract(v, w, [-1, 4]) for v, w in ((line, wx), (line, dx), (turn, wx), (lift, wx))
    )
    last = graph.constant("gradient_axis", np.array([1]))
    gradient = [graph.apply("Unsqueeze", g, last) for g in (gx, gy, gz)]
    return value, graph.apply("Concat", *gradient, axis=1)

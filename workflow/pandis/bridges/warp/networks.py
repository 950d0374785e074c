"""Sine networks in Warp: values, and gradients by forward differentiation, in single precision.

The width is a constant in each network's function, because each thread stores the layers in
registers or local memory.
"""

from functools import cache

import warp as wp

from pandis.bridges.warp.data import Answer, Field
from pandis.bridges.warp.splines import BOUND, ZERO, dense_sum, in_mesh_units, into_box, off_edge

wp.set_module_options({"enable_backward": False})


@wp.func
def corrected(
    field: Field, value: wp.float32, direction: wp.vec3f, box: wp.vec3d, outside: wp.float64
) -> Answer:
    """Return a network's answer: its outputs plus its coarse spline, if it has one."""
    d = wp.float64(value) + outside
    g = wp.vec3d(wp.float64(direction[0]), wp.float64(direction[1]), wp.float64(direction[2]))
    if field.under.size > 0:
        base = dense_sum(field.under, field.under_values, off_edge(box))
        d += base.value
        g += base.gradient
    flag = int(0)
    if outside > ZERO:
        flag = BOUND
    return in_mesh_units(field, d, g, flag)


@wp.func
def four(values: wp.array2d(dtype=wp.float32), row: wp.int32, j: wp.int32) -> wp.vec4f:
    return wp.vec4f(values[row, j], values[row, j + 1], values[row, j + 2], values[row, j + 3])


@wp.func
def four_biases(field: Field, at: wp.int32) -> wp.vec4f:
    b = field.biases
    return wp.vec4f(b[at], b[at + 1], b[at + 2], b[at + 3])


@cache
def network_answer(width, outputs):
    """Return the function from (Field, point) to Answer, mesh units, for networks of one width.

    Parameters
    ----------
    width : int
    outputs : {1, 4}
        1: the network gives only the distance, whose gradient is the direction. 4: it gives both.
    """
    STRIDE = wp.constant(-(-int(width) // 16) * 16)
    ROOM = wp.constant(2 * STRIDE)

    @wp.func
    def with_gradient(field: Field, point: wp.vec3d) -> Answer:
        u = (point - field.centre) * field.scale
        box = into_box(u)
        outside = wp.length(u - box)
        x = wp.vec3f(float(box[0]), float(box[1]), float(box[2]))
        # two alternating layers: values, and their derivatives along each axis
        units = int(STRIDE)  # a variable, so that loops up to it are not unrolled
        h = wp.zeros(shape=ROOM, dtype=wp.float32)
        dh = wp.zeros(shape=ROOM, dtype=wp.vec3f)
        for j in range(units):
            w = wp.vec3f(field.first[0, j], field.first[1, j], field.first[2, j])
            z = wp.dot(w, x) + field.biases[j]
            h[j] = wp.sin(z)
            dh[j] = wp.cos(z) * w
        old = int(0)
        for layer in range(1, field.depth):
            new, above = STRIDE - old, (layer - 1) * STRIDE
            for j in range(0, units, 4):  # four units and four rows at once: sums as in pandis.h
                sums = wp.vec4f()
                along_x, along_y, along_z = wp.vec4f(), wp.vec4f(), wp.vec4f()
                for i in range(0, units, 4):
                    a, b = four(field.hidden, above + i, j), four(field.hidden, above + i + 1, j)
                    c, d = (
                        four(field.hidden, above + i + 2, j),
                        four(field.hidden, above + i + 3, j),
                    )
                    at = old + i
                    ga, gb, gc, gd = dh[at], dh[at + 1], dh[at + 2], dh[at + 3]
                    sums += (a * h[at] + b * h[at + 1]) + (c * h[at + 2] + d * h[at + 3])
                    along_x += (a * ga[0] + b * gb[0]) + (c * gc[0] + d * gd[0])
                    along_y += (a * ga[1] + b * gb[1]) + (c * gc[1] + d * gd[1])
                    along_z += (a * ga[2] + b * gb[2]) + (c * gc[2] + d * gd[2])
                sums += four_biases(field, layer * STRIDE + j)
                for k in range(4):
                    h[new + j + k] = wp.sin(sums[k])
                    slope = wp.vec3f(along_x[k], along_y[k], along_z[k])
                    dh[new + j + k] = wp.cos(sums[k]) * slope
            old = new
        value, gradient = float(0.0), wp.vec3f()
        for i in range(units):
            value += field.last[0, i] * h[old + i]
            gradient += field.last[0, i] * dh[old + i]
        value += field.biases[field.depth * STRIDE]
        return corrected(field, value, gradient, box, outside)

    @wp.func
    def with_direction(field: Field, point: wp.vec3d) -> Answer:
        u = (point - field.centre) * field.scale
        box = into_box(u)
        outside = wp.length(u - box)
        x = wp.vec3f(float(box[0]), float(box[1]), float(box[2]))
        units = int(STRIDE)  # a variable, so that loops up to it are not unrolled
        h = wp.zeros(shape=ROOM, dtype=wp.float32)
        for j in range(units):
            w = wp.vec3f(field.first[0, j], field.first[1, j], field.first[2, j])
            h[j] = wp.sin(wp.dot(w, x) + field.biases[j])
        old = int(0)
        for layer in range(1, field.depth):
            new, above = STRIDE - old, (layer - 1) * STRIDE
            for j in range(0, units, 4):
                sums = wp.vec4f()
                for i in range(0, units, 4):
                    a, b = four(field.hidden, above + i, j), four(field.hidden, above + i + 1, j)
                    c, d = (
                        four(field.hidden, above + i + 2, j),
                        four(field.hidden, above + i + 3, j),
                    )
                    at = old + i
                    sums += (a * h[at] + b * h[at + 1]) + (c * h[at + 2] + d * h[at + 3])
                sums += four_biases(field, layer * STRIDE + j)
                for k in range(4):
                    h[new + j + k] = wp.sin(sums[k])
            old = new
        out = four_biases(field, field.depth * STRIDE)
        for i in range(units):
            for k in range(4):
                out[k] += field.last[k, i] * h[old + i]
        return corrected(field, out[0], wp.vec3f(out[1], out[2], out[3]), box, outside)

    return with_gradient if outputs == 1 else with_direction

"""Splines in Warp, in double precision, as in parts/bsplines.h and parts/spline.h."""

from typing import Any

import warp as wp

from pandis.bridges.warp.data import Answer, Field, Lattice

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BOUND, INVALID = wp.constant(1), wp.constant(2)
#: Coordinates are clamped to ±EDGE, so that a point on a face of the box is in a cell inside it.
EDGE = wp.constant(wp.float64(1 - 1e-12))
NO_BRICK = wp.constant(65535)
#: Largest shift of a point near a crease, in steps; smallest deficit of the squared gradient.
LIFT, SHORT = wp.constant(wp.float64(0.7)), wp.constant(wp.float64(0.02))
TINY = wp.constant(wp.float64(1e-150))
ZERO, ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(1.0))


@wp.struct
class Sum:
    """A value with its gradient; ``covered`` is 0 where the lattice has no value."""

    covered: wp.int32
    value: wp.float64
    gradient: wp.vec3d


@wp.struct
class Axis:
    """The cell of a point along an axis: the first of four nodes, their weights and slopes."""

    within: wp.int32
    first: wp.int32
    weights: wp.vec4d
    slopes: wp.vec4d


@wp.func
def along(lattice: Lattice, at: wp.float64) -> Axis:
    axis = Axis()
    two, three = wp.float64(2.0), wp.float64(3.0)
    four, six = wp.float64(4.0), wp.float64(6.0)
    x = (at - lattice.low) * lattice.per_step
    whole = wp.floor(x)
    if not (whole >= ONE and whole <= wp.float64(lattice.size - 3)):
        return axis
    axis.within = 1
    axis.first = int(whole) - 1
    t = x - whole
    s = ONE - t
    axis.weights = wp.vec4d(
        s * s * s / six,
        (four - six * t * t + three * t * t * t) / six,
        (four - six * s * s + three * s * s * s) / six,
        t * t * t / six,
    )
    axis.slopes = lattice.per_step * wp.vec4d(
        -s * s / two, t * (three * t - four) / two, -s * (three * s - four) / two, t * t / two
    )
    return axis


@wp.func
def with_row(total: Sum, x: Axis, y: Axis, z: Axis, i: wp.int32, j: wp.int32, c: wp.vec4d) -> Sum:
    """Add a cell's row (i, j), which has four coefficients along z, to a sum."""
    flat, steep = wp.dot(c, z.weights), wp.dot(c, z.slopes)
    a, b = x.weights[i], y.weights[j]
    total.value += a * b * flat
    total.gradient += wp.vec3d(x.slopes[i] * b * flat, a * y.slopes[j] * flat, a * b * steep)
    return total


@wp.func
def block_at(lattice: Lattice, x: wp.int32, y: wp.int32, z: wp.int32) -> wp.int32:
    """Return the index of the first coefficient of a node's block; -1 if it is not stored."""
    n = lattice.bricks
    brick = int(lattice.brick[((x >> 3) * n + (y >> 3)) * n + (z >> 3)])
    if brick == NO_BRICK:
        return -1
    bit = wp.uint64(((x >> 1 & 3) << 4) | ((y >> 1 & 3) << 2) | (z >> 1 & 3))
    one = wp.uint64(1)
    mask = lattice.mask[brick]
    if ((mask >> bit) & one) == wp.uint64(0):
        return -1
    before = wp.bit_count(mask & ((one << bit) - one))
    return (int(lattice.base[brick]) + int(before)) * 8


@wp.func
def restored(lattice: Lattice, stored: wp.float64) -> wp.float64:
    return wp.float64(wp.float32(lattice.offset + lattice.scale * stored))


@wp.func
def lattice_sum(lattice: Lattice, values: Any, p: wp.vec3d, whole: wp.int32) -> Sum:
    """Return a sparse lattice's sum; empty if ``whole`` is 1 and a coefficient is missing."""
    total = Sum()
    x, y, z = along(lattice, p[0]), along(lattice, p[1]), along(lattice, p[2])
    if x.within + y.within + z.within < 3:
        return total
    total.covered = 1
    # loops over constants are unrolled, so that vectors stay in registers
    for i in range(4):
        for j in range(4):
            nx, ny = x.first + i, y.first + j
            place = ((nx & 1) << 2) | ((ny & 1) << 1)
            c = wp.vec4d()
            block = int(-1)
            for k in range(4):
                nz = z.first + k
                if k == 0 or (nz & 1) == 0:
                    block = block_at(lattice, nx, ny, nz)
                    if block < 0 and whole == 1:
                        return Sum()
                if block >= 0:
                    c[k] = restored(lattice, wp.float64(values[block + place + (nz & 1)]))
            total = with_row(total, x, y, z, i, j, c)
    return total


@wp.func
def dense_sum(lattice: Lattice, values: Any, p: wp.vec3d) -> Sum:
    """Return a dense lattice's sum."""
    total = Sum()
    x, y, z = along(lattice, p[0]), along(lattice, p[1]), along(lattice, p[2])
    if x.within + y.within + z.within < 3:
        return total
    total.covered = 1
    for i in range(4):
        for j in range(4):
            row = ((x.first + i) * lattice.size + y.first + j) * lattice.size + z.first
            c = wp.vec4d()
            for k in range(4):
                c[k] = restored(lattice, wp.float64(values[row + k]))
            total = with_row(total, x, y, z, i, j, c)
    return total


@wp.func
def both(field: Field, p: wp.vec3d) -> Sum:
    """Return the sum of both lattices; covered where the coarse one is."""
    total = lattice_sum(field.coarse, field.coarse_values, p, 1)
    if total.covered == 1:
        more = lattice_sum(field.fine, field.fine_values, p, 0)
        total.value += more.value
        total.gradient += more.gradient
    return total


@wp.func
def sharpened(field: Field, p: wp.vec3d, total: Sum) -> Sum:
    """Evaluate above a rounded crease, and extrapolate the answer back down."""
    g = total.gradient
    missing = (ONE - wp.dot(g, g) - SHORT) / (ONE - SHORT)
    if not (missing > ZERO and total.value < ZERO):
        return total
    lift = wp.min(LIFT / field.coarse.per_step, -total.value)
    lift = lift * missing * missing * (wp.float64(3.0) - wp.float64(2.0) * missing)
    above = both(field, p + lift * g)
    slope, length = wp.length(g), wp.length(above.gradient)
    if above.covered == 0 or not (slope > TINY and length > TINY):
        return total
    normal = above.gradient / length
    total.value = above.value - lift * wp.dot(g, normal)
    total.gradient = slope * normal
    return total


@wp.func
def beyond(field: Field, p: wp.vec3d, outside: wp.float64) -> Sum:
    """Return the third lattice's estimate beyond the band; a bit per block gives the side."""
    total = dense_sum(field.far, field.far_values, p)
    block = wp.vec3i()
    for k in range(3):
        at = (p[k] - field.coarse.low) * field.coarse.per_step
        at = wp.floor(wp.min(at, wp.float64(field.coarse.size - 2)) / wp.float64(2.0))
        block[k] = int(wp.max(at, ZERO))
    count = 4 * field.coarse.bricks
    bit = (block[0] * count + block[1]) * count + block[2]
    free = ((int(field.side[bit >> 3]) >> (7 - (bit & 7))) & 1) == 1
    if free or outside > ZERO:
        total.value = wp.max(total.value, field.outside) + outside
    else:
        total.value = wp.min(total.value, -field.inside)
    return total


@wp.func
def into_box(u: wp.vec3d) -> wp.vec3d:
    return wp.vec3d(wp.clamp(u[0], -ONE, ONE), wp.clamp(u[1], -ONE, ONE), wp.clamp(u[2], -ONE, ONE))


@wp.func
def off_edge(p: wp.vec3d) -> wp.vec3d:
    return wp.vec3d(
        wp.clamp(p[0], -EDGE, EDGE), wp.clamp(p[1], -EDGE, EDGE), wp.clamp(p[2], -EDGE, EDGE)
    )


@wp.func
def in_mesh_units(field: Field, d: wp.float64, direction: wp.vec3d, flag: wp.int32) -> Answer:
    """Return an answer in mesh units, with a normal of unit length."""
    answer = Answer()
    length = wp.length(direction)
    answer.distance = d / field.scale
    answer.normal = wp.vec3d(ZERO, ZERO, ONE)
    if length > TINY:
        answer.normal = direction / length
    answer.flag = flag
    return answer


@wp.func
def spline_answer(field: Field, point: wp.vec3d) -> Answer:
    """Return a spline's answer at a point, in mesh units."""
    u = (point - field.centre) * field.scale
    box = into_box(u)
    outside = wp.length(u - box)
    p = off_edge(box)
    if outside == ZERO:
        total = both(field, p)
        if total.covered == 1:
            total = sharpened(field, p, total)
            return in_mesh_units(field, total.value, total.gradient, 0)
    total = beyond(field, p, outside)
    return in_mesh_units(field, total.value, total.gradient, BOUND)

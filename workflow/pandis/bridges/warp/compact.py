"""Compact meshes in Warp: closest points and sides as in parts/mesh.h and parts/compact.h."""

import warp as wp

from pandis.bridges.warp.data import HALF, ROOM, Answer, Field
from pandis.bridges.warp.nearest import (
    NONE,
    Block,
    block_of,
    branch_of,
    byte_of,
    child_of,
    corner_number,
    corner_steps,
    nearest_face,
    word_at,
)
from pandis.bridges.warp.splines import BOUND, INVALID, ONE, TINY, ZERO, in_mesh_units
from pandis.engine.cuda.feet import Foot, inner_foot, rim_foot

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BY_FACE, OUTSIDE, INSIDE = wp.constant(0), wp.constant(1), wp.constant(2)
MIDDLE = wp.constant(wp.float64(HALF))
#: For points beyond this, the nearest face is sought from a nearer point in the same direction.
FAR = wp.constant(wp.float64(1024.0))
#: Below this distance the direction to the closest point has lost too many digits.
CLOSE = wp.constant(wp.float64(1e-9))
WAITING = wp.constant(ROOM)


@wp.func
def corner_at(field: Field, b: Block, place: wp.int32, corner: wp.int32) -> wp.vec3d:
    steps = corner_steps(field.packed, b, corner_number(field, b, place, corner))
    at = b.origin + steps
    return wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), wp.float64(at[2]))


@wp.func
def two_bits(field: Field, list_at: wp.int32, number: wp.int32) -> wp.int32:
    word = word_at(field.packed, list_at + (number >> 2))
    return (byte_of(word, 0) >> (2 * (number & 3))) & 3


@wp.func
def what_tells(field: Field, b: Block, place: wp.int32, foot: Foot) -> wp.int32:
    """Return how to tell whether points with this foot are inside."""
    if b.has_sides == 0:
        return BY_FACE
    edges = b.sides + ((b.corner_count + 3) >> 2)
    tells = int(BY_FACE)
    if foot.corner >= 0:
        tells = two_bits(field, b.sides, corner_number(field, b, place, foot.corner))
    elif foot.edge >= 0:
        tells = two_bits(field, edges, 3 * place + foot.edge)
    if tells == BY_FACE:
        tells = two_bits(field, edges + 6 * b.groups, place)
    return tells


@wp.func
def ahead(
    x0: wp.uint64, y0: wp.uint64, z0: wp.uint64, x1: wp.uint64, y1: wp.uint64, z1: wp.uint64,
    place: wp.int32, origin: wp.vec3i, shift: wp.vec3i, p: wp.vec3d,
) -> wp.bool:  # fmt: skip
    """Return whether the ray from ``p`` along +x meets box number ``place`` of eight."""
    return (
        p[0] <= wp.float64(origin[0] + (byte_of(x1, place) << shift[0]))
        and p[1] >= wp.float64(origin[1] + (byte_of(y0, place) << shift[1]))
        and p[1] <= wp.float64(origin[1] + (byte_of(y1, place) << shift[1]))
        and p[2] >= wp.float64(origin[2] + (byte_of(z0, place) << shift[2]))
        and p[2] <= wp.float64(origin[2] + (byte_of(z1, place) << shift[2]))
    )


@wp.func
def beside(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d) -> wp.float64:
    """Return twice the signed area of edge ab and p, seen along x; swapping a and b negates it."""
    s, e, sign = a, b, wp.float64(1.0)
    if a[1] > b[1] or (a[1] == b[1] and a[2] > b[2]):
        s, e, sign = b, a, wp.float64(-1.0)
    return sign * ((e[1] - s[1]) * (p[2] - s[2]) - (e[2] - s[2]) * (p[1] - s[1]))


@wp.func
def on_left(a: wp.vec3d, b: wp.vec3d, area: wp.float64) -> wp.int32:
    if area > ZERO or (area == ZERO and (a[1] < b[1] or (a[1] == b[1] and a[2] < b[2]))):
        return 1
    return 0


@wp.func
def crossing(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, p: wp.vec3d) -> wp.int32:
    """Return what a face adds to the winding number of ``p``, counted on the ray along +x."""
    ab, bc, ca = beside(a, b, p), beside(b, c, p), beside(c, a, p)
    left = on_left(a, b, ab) + on_left(b, c, bc) + on_left(c, a, ca)
    whole = ab + bc + ca
    if left % 3 != 0 or not (whole < ZERO or whole > ZERO):
        return 0
    if c[0] * (ab / whole) + a[0] * (bc / whole) + b[0] * (ca / whole) > p[0]:
        if whole > ZERO:
            return 1
        return -1
    return 0


@wp.func
def turns_in_block(field: Field, number: wp.int32, p: wp.vec3d) -> wp.int32:
    b, w = block_of(field, number), field.packed
    at, turns = b.boxes, int(0)
    x0, y0, z0 = word_at(w, at), word_at(w, at + 8), word_at(w, at + 16)
    x1, y1, z1 = word_at(w, at + 24), word_at(w, at + 32), word_at(w, at + 40)
    for place in range(b.face_count):
        if ahead(x0, y0, z0, x1, y1, z1, place >> 3, b.origin, b.shift, p):
            turns += crossing(
                corner_at(field, b, place, 0), corner_at(field, b, place, 1),
                corner_at(field, b, place, 2), p,
            )  # fmt: skip
    return turns


@wp.func
def winding(field: Field, p: wp.vec3d) -> wp.int32:
    """Return the winding number of ``p``: exits minus entries, counted on the ray along +x."""
    waiting = wp.zeros(shape=WAITING, dtype=wp.int32)
    top, turns, w = int(1), int(0), field.branches
    while top > 0:
        top -= 1
        child = waiting[top]
        if child < 0:
            turns += turns_in_block(field, ~child, p)
        else:
            b, at = branch_of(field, child), 12 * child + 2
            for i in range(b.count):
                if ahead(
                    w[at], w[at + 1], w[at + 2], w[at + 3], w[at + 4], w[at + 5],
                    i, b.origin, b.shift, p,
                ):  # fmt: skip
                    waiting[top] = child_of(field, child, i)
                    top += 1
    return turns


@wp.func
def compact_answer(field: Field, point: wp.vec3d) -> Answer:
    """Return a compact mesh's answer at a point, in mesh units; queries are never cut short."""
    u = (point - field.centre) * field.scale
    most, nearer, size = wp.max(wp.abs(u)), wp.float64(1.0), wp.float64(field.step)
    if most > FAR:
        nearer = FAR / most
    half = wp.vec3d(MIDDLE, MIDDLE, MIDDLE)
    p = (u * nearer + half) / field.step
    face = nearest_face(field, p)
    if face == NONE:
        return in_mesh_units(field, wp.float64(wp.nan), half, INVALID)
    b, place = block_of(field, face >> 6), face & 63
    c0, c1 = corner_at(field, b, place, 0), corner_at(field, b, place, 1)
    c2 = corner_at(field, b, place, 2)
    if nearer < ONE:  # in the unit frame, where squares do not overflow
        size, p = wp.float64(1.0), u
        c0, c1 = c0 * field.step - half, c1 * field.step - half
        c2 = c2 * field.step - half
    foot = inner_foot(c0, c1, c2, p)
    if foot.corner == 0 and foot.edge == 0:
        foot = rim_foot(c0, c1, c2, p)
    distance = wp.length(foot.offset)
    n = wp.cross(c1 - c0, c2 - c0)
    length = wp.length(n)
    if length > TINY:
        n = n / length
    else:
        n = wp.vec3d(ZERO, ZERO, ONE)
    inside = bool(False)
    if most <= field.reach:
        tells = what_tells(field, b, place, foot)
        if tells == BY_FACE:
            inside = wp.dot(foot.offset, n) < ZERO
        elif tells == INSIDE:
            inside = True
        elif tells != OUTSIDE:
            inside = winding(field, p) > 0
    sign, flag = wp.float64(1.0), int(0)
    if inside:
        sign = wp.float64(-1.0)
    if distance * size > CLOSE:
        n = sign * (foot.offset / distance)
    if most > ONE:
        flag = BOUND
    return in_mesh_units(field, sign * distance * size, n, flag)

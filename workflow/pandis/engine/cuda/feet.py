"""Closest points on a triangle in Warp, in double precision, as in parts/mesh.h."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ZERO, ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(1.0))


@wp.struct
class Foot:
    """The vector from a face's closest point to the query; that point's corner or edge, or -1."""

    offset: wp.vec3d
    corner: wp.int32
    edge: wp.int32


@wp.func
def inner_foot(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, p: wp.vec3d) -> Foot:
    """Return the foot in the interior of a face. If there is none, edge and corner are both 0."""
    foot = Foot()
    u, v, x = b - a, c - a, p - a
    n = wp.cross(u, v)
    n -= wp.dot(n, u) / wp.dot(u, u) * u
    det = wp.dot(n, n)
    if not (det > ZERO):
        return foot
    across = wp.cross(x, n)
    beside = wp.dot(c - b, wp.cross(p - b, n))
    if wp.dot(v, across) < ZERO and wp.dot(u, across) > ZERO and beside > ZERO:
        foot.offset = wp.dot(n, x) / det * n
        foot.corner = -1
        foot.edge = -1
    return foot


@wp.func
def rim_foot(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, p: wp.vec3d) -> Foot:
    """Return the foot on the edges of a face."""
    foot = Foot()
    best = wp.float64(wp.inf)
    for k in range(3):
        start, end = a, b
        if k == 1:
            start, end = b, c
        elif k == 2:
            start, end = c, a
        u, x = end - start, p - start
        length, t = wp.dot(u, u), wp.float64(0.0)
        if length > ZERO:
            t = wp.clamp(wp.dot(u, x) / length, ZERO, ONE)
        offset = x - t * u
        if t > wp.float64(0.5):  # measure from the nearer end to reduce cancellation
            offset = (p - end) + (ONE - t) * u
        squared = wp.dot(offset, offset)
        if squared < best:
            best = squared
            foot.offset = offset
            foot.corner = -1
            foot.edge = -1
            if t == ZERO:
                foot.corner = k
            elif t == ONE:
                foot.corner = (k + 1) % 3
            else:
                foot.edge = k
    return foot

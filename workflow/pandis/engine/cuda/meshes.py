"""Exact distances to meshes in Warp, for millions of labels: parts/mesh.h in double precision.

The tree is that of `pandis.engine.bvh`, whose boxes are rounded outward. As on the host, the boxes
and faces that may be nearest are selected in single precision, with a margin for its error; extra
candidates do not change the result. Closest points on these faces are computed in double precision,
so distances differ from the host's only by rounding.
"""

import threading

import numpy as np
import warp as wp

from pandis.engine.bvh import LEAF_BYTES, NODE_BYTES
from pandis.engine.cuda.feet import ONE, ZERO, Foot, inner_foot, rim_foot

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

#: Capacity of a query's queue of boxes and leaves. It needs seven entries per level, plus one.
ROOM = 448
_ROOM = wp.constant(ROOM)
#: Bound on the relative error of single precision in a coordinate and in a sum of squares.
_WRONG = wp.constant(wp.float32(1e-6))
_WORDS = NODE_BYTES // 4
_PLACES = LEAF_BYTES // 4


@wp.struct
class Tree:
    """A mesh and the tree over its faces.

    The nodes have ``boxes`` (n, 48) and ``children`` (n, 8). The leaves have rounded ``corners``
    (l, 72), faces (l, 8) in ``leaves``, and origin, step, slack and share (l, 6) in ``places``.
    """

    boxes: wp.array2d(dtype=wp.float32)
    children: wp.array2d(dtype=wp.int32)
    corners: wp.array2d(dtype=wp.uint16)
    leaves: wp.array2d(dtype=wp.int32)
    places: wp.array2d(dtype=wp.float32)
    vertices: wp.array(dtype=wp.vec3d)
    vertex_normals: wp.array(dtype=wp.vec3d)
    faces: wp.array(dtype=wp.vec3i)
    neighbours: wp.array(dtype=wp.vec3i)
    reach: wp.float64


@wp.struct
class Nearest:
    """The nearest face so far, its foot, and the squared distance."""

    face: wp.int32
    squared: wp.float64
    foot: Foot


@wp.func
def face_foot(tree: Tree, face: wp.int32, p: wp.vec3d) -> Foot:
    """Return the foot on a face: the vector from the closest point, and its corner or edge."""
    c = tree.faces[face]
    a, b, d = tree.vertices[c[0]], tree.vertices[c[1]], tree.vertices[c[2]]
    foot = inner_foot(a, b, d, p)
    if foot.corner == 0 and foot.edge == 0:
        foot = rim_foot(a, b, d, p)
    return foot


@wp.func
def face_normal(tree: Tree, face: wp.int32) -> wp.vec3d:
    """Return the unit normal of a face; zero if it has no area."""
    c = tree.faces[face]
    a = tree.vertices[c[0]]
    return wp.normalize(wp.cross(tree.vertices[c[1]] - a, tree.vertices[c[2]] - a))


@wp.func
def pseudonormal(tree: Tree, face: wp.int32, foot: Foot) -> wp.vec3d:
    """Return the angle-weighted normal of the corner, edge or face that a foot is on."""
    if foot.corner >= 0:
        n = tree.vertex_normals[tree.faces[face][foot.corner]]
        if wp.dot(n, n) > ZERO:
            return n
    n = face_normal(tree, face)
    if foot.edge >= 0:
        other = tree.neighbours[face][foot.edge]
        if other >= 0:
            n = wp.normalize(n + face_normal(tree, other))
    if not (wp.dot(n, n) > ZERO):
        n = wp.vec3d(ZERO, ZERO, ONE)
    return n


@wp.func
def box_squared(tree: Tree, node: wp.int32, place: wp.int32, p: wp.vec3f) -> wp.float32:
    """Return a lower bound on the squared distance to a child's box; infinite if there is none."""
    sum = wp.float32(0.0)
    for k in range(3):
        low = tree.boxes[node, 8 * k + place]
        high = tree.boxes[node, 24 + 8 * k + place]
        off = wp.max(low - p[k], p[k] - high) - _WRONG * wp.abs(p[k])
        off = wp.max(off, wp.float32(0.0))
        sum += off * off
    return sum * (wp.float32(1.0) - _WRONG)


@wp.func
def share_of_edge(t: wp.float32) -> wp.float32:
    """Return a number clamped to [0, 1]; 0 for NaN."""
    if not (t > wp.float32(0.0)):
        return wp.float32(0.0)
    return wp.min(t, wp.float32(1.0))


@wp.func
def rounded(tree: Tree, leaf: wp.int32, corner: wp.int32, place: wp.int32) -> wp.vec3f:
    """Return a corner of a rounded triangle, in steps from its leaf's origin."""
    at = 24 * corner + place
    return wp.vec3f(
        wp.float32(tree.corners[leaf, at]),
        wp.float32(tree.corners[leaf, at + 8]),
        wp.float32(tree.corners[leaf, at + 16]),
    )


@wp.func
def seems(tree: Tree, leaf: wp.int32, place: wp.int32, q: wp.vec3f) -> wp.float32:
    """Return the squared distance to a rounded triangle, in steps: see pandis__eight_distances."""
    a = rounded(tree, leaf, 0, place)
    u, v, x = rounded(tree, leaf, 1, place) - a, rounded(tree, leaf, 2, place) - a, q - a
    w, b = v - u, x - u
    rest = x - share_of_edge(wp.dot(u, x) / wp.dot(u, u)) * u
    best = wp.dot(rest, rest)
    rest = x - share_of_edge(wp.dot(v, x) / wp.dot(v, v)) * v
    best = wp.min(best, wp.dot(rest, rest))
    rest = b - share_of_edge(wp.dot(w, b) / wp.dot(w, w)) * w
    best = wp.min(best, wp.dot(rest, rest))
    n = wp.cross(u, v)
    per = wp.float32(1.0) / wp.dot(n, n)
    s, t = wp.dot(wp.cross(x, v), n) * per, wp.dot(wp.cross(u, x), n) * per
    if s >= wp.float32(0.0) and t >= wp.float32(0.0) and s + t <= wp.float32(1.0):
        rest = x - s * u - t * v
        best = wp.min(best, wp.dot(rest, rest))
    return best


@wp.func
def nearest_face(tree: Tree, p: wp.vec3d) -> Nearest:
    """Return the nearest face; among equally near faces, the one with the smallest index."""
    waiting = wp.zeros(shape=_ROOM, dtype=wp.int32)
    keys = wp.zeros(shape=_ROOM, dtype=wp.float32)
    seem = wp.zeros(shape=8, dtype=wp.float32)
    near, bound = wp.vec3f(p), wp.float32(wp.inf)
    best = Nearest()
    best.face = 2147483647
    best.squared = wp.float64(wp.inf)
    top, eight = int(1), int(8)
    while top > 0:
        top -= 1
        child = waiting[top]
        if keys[top] <= bound:
            if child < 0:
                leaf = ~child
                step = tree.places[leaf, 3]
                slack, share = tree.places[leaf, 4], tree.places[leaf, 5]
                q, least = wp.vec3f(), wp.float32(wp.inf)
                for k in range(3):
                    q[k] = wp.float32((p[k] - wp.float64(tree.places[leaf, k])) / wp.float64(step))
                for i in range(eight):
                    seem[i] = seems(tree, leaf, i, q)
                    least = wp.min(least, seem[i])
                one, far = wp.float32(1.0), wp.float32(wp.inf)
                if least < far:  # else the squares overflow single precision
                    most = (wp.sqrt(least) * step * (one + share) + slack) * (one + _WRONG)
                    bound = wp.min(bound, most * most * (one + _WRONG))
                    far = (wp.sqrt(bound) + slack) * (one + wp.float32(2.0) * share) / step
                    far = far * far * (one + wp.float32(4.0) * _WRONG)
                for i in range(eight):
                    face = tree.leaves[leaf, i]
                    if face >= 0 and not (seem[i] > far):
                        foot = face_foot(tree, face, p)
                        squared = wp.dot(foot.offset, foot.offset)
                        if squared < best.squared or (squared == best.squared and face < best.face):
                            best.face = face
                            best.squared = squared
                            best.foot = foot
                            bound = wp.min(bound, wp.float32(squared) * (one + _WRONG))
            else:
                first = top
                for i in range(eight):  # insertion sort, so that the nearest is popped first
                    least = box_squared(tree, child, i, near)
                    if least <= bound and least < wp.float32(wp.inf):
                        at = top
                        while at > first and keys[wp.max(at - 1, 0)] < least:
                            waiting[at] = waiting[at - 1]
                            keys[at] = keys[at - 1]
                            at -= 1
                        waiting[at] = tree.children[child, i]
                        keys[at] = least
                        top += 1
    return best


@wp.func
def spread(x: wp.float64) -> wp.int32:
    """Return the ten bits of a coordinate's place in [-1, 1], two zeros after each."""
    bits = wp.int32(wp.clamp(wp.float64(512.0) * (x + ONE), ZERO, wp.float64(1023.0)))
    bits = (bits | (bits << 16)) & 0x030000FF
    bits = (bits | (bits << 8)) & 0x0300F00F
    bits = (bits | (bits << 4)) & 0x030C30C3
    return (bits | (bits << 2)) & 0x09249249


@wp.kernel
def find_places(
    points: wp.array(dtype=wp.vec3d),
    places: wp.array(dtype=wp.int32),
    order: wp.array(dtype=wp.int32),
):
    """Compute the points' places on a Z-order curve."""
    i = wp.tid()
    p = points[i]
    places[i] = spread(p[0]) | (spread(p[1]) << 1) | (spread(p[2]) << 2)
    order[i] = i


@wp.kernel
def label(
    tree: Tree,
    points: wp.array(dtype=wp.vec3d),
    order: wp.array(dtype=wp.int32),
    on_surface: wp.float64,
    distances: wp.array(dtype=wp.float64),
    normals: wp.array(dtype=wp.vec3d),
):
    """Compute signed distances and directions, as `pandis.engine.bvh.Bvh.label` does."""
    i = order[wp.tid()]
    p = points[i]
    best = nearest_face(tree, p)
    n = pseudonormal(tree, best.face, best.foot)
    distance, sign = wp.length(best.foot.offset), wp.float64(1.0)
    within = wp.max(wp.max(wp.abs(p[0]), wp.abs(p[1])), wp.abs(p[2])) <= tree.reach
    if within and wp.dot(best.foot.offset, n) < ZERO:
        sign = wp.float64(-1.0)
    distances[i] = sign * distance
    if distance > on_surface:
        n = sign * (best.foot.offset / distance)
    normals[i] = n


class MeshLabels:
    """Labels points with distances to a mesh, on a Warp device.

    Concurrent calls wait for each other.

    Parameters
    ----------
    parts : dict of str to bytes
        Parts of the tree: `pandis.engine.bvh.Bvh.parts`.
    reach : float
        The largest absolute coordinate.
    device : optional
        A Warp device; Warp's default device if None.

    Raises
    ------
    RuntimeError
        There is no such device, or the tree is too deep for `ROOM`.
    """

    def __init__(self, parts, reach, device=None):
        self.device = wp.get_device(device)
        nodes = np.frombuffer(parts["TREE"], "<f4").reshape(-1, _WORDS)
        leaves = np.frombuffer(parts["LEAF"], "<i4").reshape(-1, _PLACES)
        boxes, children = nodes[:, :48], nodes[:, 48:].view("<i4")
        needed = 7 * _depth(boxes, children) + 1
        if needed > ROOM:
            raise RuntimeError(
                f"the tree is too deep: {needed} boxes may be queued, more than {ROOM}"
            )
        tree = Tree()
        tree.boxes = self._there(boxes, wp.float32)
        tree.children = self._there(children, wp.int32)
        tree.corners = self._there(np.ascontiguousarray(leaves[:, :36]).view("<u2"), wp.uint16)
        tree.leaves = self._there(leaves[:, 36:44], wp.int32)
        tree.places = self._there(leaves[:, 44:50].view("<f4"), wp.float32)
        for name, part, kind, dtype in (
            ("vertices", "VERT", "<f8", wp.vec3d),
            ("vertex_normals", "VNRM", "<f8", wp.vec3d),
            ("faces", "FACE", "<i4", wp.vec3i),
            ("neighbours", "NEIG", "<i4", wp.vec3i),
        ):
            values = np.frombuffer(parts[part], kind).reshape(-1, 3)
            setattr(tree, name, self._there(values, dtype))
        tree.reach = reach
        self._tree, self._lock = tree, threading.Lock()
        # this stream takes precedence over the many small training steps
        self._stream = wp.Stream(self.device, priority=-1) if self.device.is_cuda else None

    def _there(self, values, dtype):
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def label(self, points, on_surface):
        """Return distances (n,) and directions (n, 3), float64, at finite points (n, 3).

        At distances up to ``on_surface``, the direction is the pseudonormal.
        """
        with self._lock, wp.ScopedStream(self._stream):
            distances, normals = self.launch(self.upload(points), on_surface)
            return distances.numpy(), normals.numpy()

    def upload(self, points):
        """Return points (n, 3) as an array on the device."""
        return self._there(np.asarray(points, np.float64), wp.vec3d)

    def launch(self, queries, on_surface):
        """Return `label`'s results as arrays on the device; the launch is not waited for.

        Neighbouring threads take neighbouring points, which visit the same boxes.
        """
        count = len(queries)
        places = wp.empty(2 * count, dtype=wp.int32, device=self.device)  # half of it for sorting
        order = wp.empty(2 * count, dtype=wp.int32, device=self.device)
        wp.launch(find_places, count, [queries], [places, order], device=self.device)
        wp.utils.radix_sort_pairs(places, order, count)
        distances = wp.empty(count, dtype=wp.float64, device=self.device)
        normals = wp.empty(count, dtype=wp.vec3d, device=self.device)
        arguments = [self._tree, queries, order, wp.float64(on_surface)]
        wp.launch(label, count, arguments, [distances, normals], device=self.device)
        return distances, normals


def _depth(boxes, children):
    """Return the number of node levels of a tree; an infinite box means that there is no child."""
    inner = (children >= 0) & np.isfinite(boxes[:, :8])
    level, depth = np.array([0]), 0
    while len(level):
        level, depth = children[level][inner[level]], depth + 1
    return depth

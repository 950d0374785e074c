"""Decides how the side of a point is found on a mesh whose vertices are on a lattice.

Usually the normal of the nearest face gives the side. It does not at corners and edges whose faces
are far from coplanar. All points nearest to such a corner or edge are on the same side, so a test
point beside it decides for all. Rounding can also fold a surface over itself, by less than a step.
A face that points the wrong way is then on top, and would give the wrong side to every point
nearest to it. So every face is checked from both sides, and so are sharply folded edges. Around
faces that are wrong, the side is found by counting the crossings of a ray.
"""

import numpy as np

from pandis.engine.bvh import Bvh
from pandis.engine.packing import BY_FACE, BY_RAY, INSIDE, OUTSIDE, Sides, find_rays

#: Distance from a face, in steps, of the points that check it: less than the height of any fold.
_BESIDE = 1e-3
#: Two neighbouring faces count as folded onto each other if the cosine between their normals is
#: below _FOLD and at least one of them is less than _LOW steps high. Rounding does not fold higher
#: faces.
_FOLD, _LOW = -0.7, 4.0
#: Faces give the side at a corner if the cosine between each normal around it and their mean is at
#: least this, as in packing/sides.h.
_SMOOTH = 0.82
#: Within this many rings around a face that points the wrong way, faces may cross each other.
_RINGS = 2


def find_sides(vertices, faces):
    """Return how sides are found at the corners, edges and faces of a closed mesh on a lattice.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), int32
    faces : ndarray, shape (F, 3), int32

    Returns
    -------
    pandis.engine.packing.Sides
    """
    tree = Bvh(vertices.astype(np.float64), faces)
    points, owners = find_rays(vertices, faces)
    known = _agreed(owners, tree.inside(points), len(vertices) + 3 * len(faces))
    places = vertices[faces].astype(np.float64)
    normal = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0, length, 1)[:, None]
    longest = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    wrong = tree.look_wrong(_BESIDE) | _folded(faces, normal, length < _LOW * longest)
    for _ in range(_RINGS):
        touched = np.zeros(len(vertices), bool)
        touched[faces[wrong]] = True
        wrong = touched[faces].any(axis=1)
    corners, edges = known[: len(vertices)], known[len(vertices) :].reshape(-1, 3)
    corners[faces[wrong]] = BY_RAY
    edges[touched[faces] & touched[np.roll(faces, -1, axis=1)]] = BY_RAY
    corners = _with_edges(corners, edges, faces, normal=normal)
    return Sides(corners, edges, np.where(wrong, BY_RAY, BY_FACE).astype(np.uint8))


def _folded(faces, normal, low):
    """Return a mask of the faces that are folded onto a neighbour, if either of the two is low."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    same = edge[order[:-1]] == edge[order[1:]]
    one, other = order[:-1][same] // 3, order[1:][same] // 3
    back = np.einsum("nk,nk->n", normal[one], normal[other]) < _FOLD
    back &= low[one] | low[other]
    folded = np.zeros(len(faces), bool)
    folded[one[back]] = folded[other[back]] = True
    return folded


def _with_edges(corners, edges, faces, *, normal):
    """Return the sides of corners, made consistent with those of their edges.

    In single precision, rounding can make a corner the nearest place to a distant point although,
    exactly, it is nearest to no point. Unless its faces all point in nearly the same direction,
    such a corner takes the side of its edges. The side is found by a ray where the edges contradict
    each other or the corner, and where such a corner has no edge with a side.
    """
    touched = np.zeros((len(corners), 4), bool)
    for ends in (faces, np.roll(faces, -1, axis=1)):
        touched[ends.ravel(), edges.ravel()] = True
    by_edges = np.select([touched[:, INSIDE], touched[:, OUTSIDE]], [INSIDE, OUTSIDE], BY_RAY)
    unknown = (corners == BY_FACE) & ~_smooth(faces, normal, len(corners))
    sides = np.where(unknown, by_edges, corners)
    against = (sides == INSIDE) & touched[:, OUTSIDE] | (sides == OUTSIDE) & touched[:, INSIDE]
    return np.where(against, BY_RAY, sides).astype(np.uint8)


def _smooth(faces, normal, count):
    """Return a mask of the corners at which all face normals are close to their mean."""
    owners = faces.ravel()
    around = np.repeat(normal, 3, axis=0)
    mean = np.column_stack([np.bincount(owners, around[:, k], count) for k in range(3)])
    mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
    least = np.ones(count)
    np.minimum.at(least, owners, np.einsum("nk,nk->n", around, mean[owners]))
    return least >= _SMOOTH


def _agreed(owners, inside, count):
    """Return each owner's side (count,): BY_RAY if its points disagree, BY_FACE if it has none."""
    within = np.bincount(owners, inside, count) > 0
    without = np.bincount(owners, ~inside, count) > 0
    return np.select(
        [within & without, within, without], [BY_RAY, INSIDE, OUTSIDE], BY_FACE
    ).astype(np.uint8)

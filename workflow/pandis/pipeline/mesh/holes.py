"""Fills holes with existing vertices: no vertex is added or moved.

Every rim is triangulated by dynamic programming over all triangulations of its
polygon (Barequet & Sharir 1995; weights of Liepa 2003, "Filling holes in
meshes"). Either the maximum fold or the area is minimised, whichever makes fewer
faces cross. PyMeshLab's ear cutting was rejected: it leaves one hole of the Stanford
Bunny open, or its triangles cross the mesh there.
"""

import numpy as np

from pandis.pipeline.mesh.topology import crossing_faces, edges_of

_WEIGHTS = ("fold", "area")
#: Area charged for a triangle of zero area, in a polygon scaled to size 1.
_FLAT = 1e3
#: Triangles of diagonals of one span that are compared at once.
_AT_ONCE = 1 << 18


def fill_holes(vertices, faces):
    """Close every hole.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray, shape (F, 3)
        Manifold except at the rims, and consistently oriented.

    Returns
    -------
    vertices, faces : ndarray
        The given faces come first.
    """
    edges = edges_of(faces)
    known = {tuple(edge) for edge in edges.edges.tolist()}
    rims = _rims(faces, edges)
    choice = np.zeros(len(rims), np.int64)
    caps = {}
    best = None
    for _ in range(1 + len(_WEIGHTS)):
        for k, rim in enumerate(rims):
            if (k, choice[k]) not in caps:
                weight = _WEIGHTS[choice[k]]
                caps[k, choice[k]] = triangulate(vertices, faces, rim, known=known, weight=weight)
        parts = [caps[k, choice[k]] for k in range(len(rims))]
        filled = np.concatenate([faces, *parts])
        owner = np.repeat(np.arange(len(rims)), [len(p) for p in parts])
        pairs = crossing_faces(vertices, filled, np.arange(len(filled)) >= len(faces))
        if best is None or len(pairs) < best[0]:
            best = (len(pairs), filled)
        at_fault = np.unique(owner[(pairs[pairs >= len(faces)]) - len(faces)])
        retry = at_fault[choice[at_fault] + 1 < len(_WEIGHTS)]
        if not len(retry):
            break
        choice[retry] += 1
    return vertices, best[1]


def _rims(faces, edges):
    """Return the rims as lists of half-edges, in the order in which caps traverse them."""
    half = np.flatnonzero(edges.boundary[edges.edge_of])
    start, end = edges.directed[half].T
    # a cap traverses each edge in the opposite direction to its face, from end to start
    follow = dict(zip(end.tolist(), half.tolist(), strict=True))
    if len(follow) != len(half):
        raise ValueError("a vertex lies on two rims: split non-manifold vertices first")
    begin = dict(zip(half.tolist(), start.tolist(), strict=True))
    rims = []
    while follow:
        first = next(iter(follow))
        rim, vertex = [], first
        while vertex in follow:
            h = follow.pop(vertex)
            rim.append(h)
            vertex = begin[h]
        if vertex != first:
            raise ValueError("a rim does not close: make the orientation consistent first")
        rims.append(rim)
    return rims


def triangulate(vertices, faces, rim, *, known, weight):
    """Triangulate one rim.

    Parameters
    ----------
    vertices, faces : ndarray
    rim : list of int
        Half-edges, see `_rims`.
    known : set of (int, int)
        Edges of the mesh (smaller index first), which a cap must not reuse.
    weight : {"fold", "area"}

    Returns
    -------
    ndarray, shape (len(rim) - 2, 3)
    """
    rim = np.asarray(rim)
    n = len(rim)
    corner = faces[rim // 3, (rim % 3 + 1) % 3]  # the cap's edge k runs from corner k to k + 1
    if n < 3:
        return np.empty((0, 3), np.int64)
    rim_normal = _normals(*(vertices[faces[rim // 3, k]] for k in range(3)))[0]

    def forbidden(i, k):
        return tuple(sorted((int(corner[i]), int(corner[k])))) in known

    chosen = least_cost_triangles(vertices[corner], weight, rim_normal, forbidden=forbidden)
    if not len(chosen):
        # every triangulation reuses an edge: return a fan, whose faults the diagnosis reports
        return np.stack([np.full(n - 2, corner[0]), corner[1:-1], corner[2:]], axis=1)
    return corner[chosen]


def least_cost_triangles(points, weight="area", rim_normal=None, *, forbidden=None):
    """Find the least-cost triangulation of a closed polygon in space.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    weight : {"fold", "area"}
        What to minimise. ``fold``: the largest fold, then the area. ``area``: the area, then
        the largest fold. The sum of squared edge lengths breaks remaining ties, which favours
        round triangles.
    rim_normal : ndarray, shape (n, 3), optional
        Unit normal of the face beyond each edge k, which runs from corner k to k + 1. By
        default, folds at the rim cost nothing.
    forbidden : callable, optional
        Takes two indices; returns whether the edge between them is forbidden.

    Returns
    -------
    ndarray, shape (n - 2, 3)
        Indices into ``points``; empty if all triangulations are forbidden.
    """
    n = len(points)
    points = points - points.mean(axis=0)
    points = points / max(np.abs(points).max(), 1e-300)
    if rim_normal is None:
        rim_normal = np.full((n, 3), np.nan)
    cost = np.full((n, n, 3), np.inf)  # largest fold, area, sum of squared edges
    normal = np.zeros((n, n, 3))
    middle = np.zeros((n, n), np.int64)
    step = np.arange(n - 1)
    cost[step, step + 1] = 0
    normal[step, step + 1] = rim_normal[:-1]
    order = (2, 1, 0) if weight == "fold" else (2, 0, 1)  # lexsort's primary key is last
    for span in range(2, n):
        starts = np.arange(n - span)
        if forbidden and span < n - 1:
            allowed = [start for start in starts if not forbidden(start, start + span)]
            starts = np.array(allowed, np.int64)
        for i in np.array_split(starts, 1 + len(starts) * span // _AT_ONCE):
            k = i + span
            m = i[:, None] + np.arange(1, span)
            left, right = (i[:, None], m), (m, k[:, None])
            face_normal, area = _normals(points[i, None], points[m], points[k, None])
            fold = np.maximum(_fold(face_normal, normal[left]), _fold(face_normal, normal[right]))
            if span == n - 1:
                fold = np.maximum(fold, _fold(face_normal, rim_normal[-1]))
            before, after = cost[left], cost[right]
            fold = np.maximum(fold, np.maximum(before[..., 0], after[..., 0]))
            area = np.where(area > 1e-12, area, _FLAT) + before[..., 1] + after[..., 1]
            fold = np.where(np.isfinite(area), fold, np.inf)
            chord = ((points[k] - points[i]) ** 2).sum(axis=-1)
            spread = chord[:, None] + before[..., 2] + after[..., 2]
            # sums in different orders differ in the last bits: treat such costs as equal
            keys = [np.round(key, 10) for key in (fold, area, spread)]
            best = np.arange(len(i)), np.lexsort([keys[key] for key in order])[:, 0]
            cost[i, k] = np.stack([fold[best], area[best], spread[best]], axis=-1)
            normal[i, k], middle[i, k] = face_normal[best], m[best]
    if not np.isfinite(cost[0, n - 1, 1]):
        return np.empty((0, 3), np.int64)
    triangles, waiting = [], [(0, n - 1)]
    while waiting:
        i, k = waiting.pop()
        if k - i > 1:
            m = int(middle[i, k])
            triangles.append((i, m, k))
            waiting += [(i, m), (m, k)]
    return np.asarray(triangles, np.int64)


def _normals(a, b, c):
    """Return unit normals (zero for flat triangles) and areas."""
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=-1)
    return cross / np.maximum(double, 1e-300)[..., None], double / 2


def _fold(one, other):
    """Return the angle between unit normals as 1 − cosine; 0 where there is no face."""
    return np.nan_to_num(1 - (one * other).sum(axis=-1))

"""Upper bounds on the distance from a surface to a mesh, found by branch and bound.

The distance to a triangle is a convex function, so on another triangle it is largest at a corner.
For any one face of a mesh, therefore, no point of a triangle is farther from the mesh than the
triangle's farthest corner is from that face. Where that bound is too loose, the triangle is cut
along the prism over the face nearest to its centroid. The corners of the part inside the prism
bound that part's distance. The other parts are compared with the neighbouring faces, however small
these are. A triangle whose centroid is outside its prism is split into four.
"""

from typing import NamedTuple

import numpy as np

from pandis.engine.threads import SMALL, in_threads

#: Largest accepted ratios of the bound to the largest computed distance. The smaller one applies
#: until _FEW triangles have been examined.
_TIGHT, _LOOSE, _FEW = 1.1, 1.8, 200_000
#: For each ratio, the margin of a prism around its face, as a fraction of the largest computed
#: distance.
_WIDER = {_TIGHT: 0.25, _LOOSE: 1.0}
#: Triangles with bounds up to this (unit frame) are not divided any further.
_FLOOR = 1e-7
#: Maximum number of triangles to examine; then the current bound is returned.
_MOST = 4_000_000
#: Triangles per task, few enough that their distance query starts no threads of its own.
_CHUNK = SMALL - 1


def farthest(vertices, faces, engine):
    """Bound the one-sided Hausdorff distance from a surface to a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3), integer
        Faces of the surface.
    engine : pandis.pipeline.geometry.distance.MeshDistance
        The exact distance of the mesh.

    Returns
    -------
    float
        Upper bound (unit frame). The true distance is more than half of it, usually nine tenths,
        unless the bound is at most 1e-7 or too many triangles had to be examined.
    """
    left = np.asarray(vertices, np.float64)[faces]
    used = np.asarray(vertices, np.float64)[np.unique(faces)]
    least = float(np.abs(engine.distance_and_normal(used, check=False)[0]).max())
    most, looked = 0.0, 0
    while len(left):
        looked += len(left)
        parts = in_threads(
            lambda low, high, left=left: _bounds(left[low:high], engine),
            len(left),
            -(-len(left) // _CHUNK),
        )
        above, below, faces_below = (np.concatenate(column) for column in zip(*parts, strict=True))
        least = max(least, float(below.max()))
        if not np.isfinite(above).all():
            return np.inf
        times = _TIGHT if looked < _FEW else _LOOSE
        enough = max(times * least, _FLOOR)
        settled = above <= enough
        if looked + 4 * int((~settled).sum()) > _MOST:
            return max(most, least, float(above.max()))
        most = max(most, float(above[settled].max(initial=0.0)))
        wider = _WIDER[times] * max(least, _FLOOR)
        over, beside = _cut_over(left[~settled], faces_below[~settled], wider)
        # parts over a face are settled unless they are far from it: another face may be nearer
        far = over.above > enough
        most = max(most, float(over.above[~far].max(initial=0.0)))
        left = np.concatenate([beside, _quarters(over.triangles[far])])
    return max(most, least)


def _bounds(triangles, engine):
    """Bound the largest distance of each triangle (n, 3, 3) to a mesh.

    Returns upper bounds (n,), lower bounds (n,), and the mesh's faces (n, 3, 3) nearest to the
    triangles' centroids.
    """
    labels = engine.label(triangles.mean(axis=1), ties=False, check=False)
    nearest = engine.vertices[engine.faces[labels.face]]
    return _corners_apart(triangles, nearest), np.abs(labels.distance), nearest


def _corners_apart(triangles, faces):
    """Return the distance (n,) of each triangle's farthest corner to the face of the same index."""
    apart = [distance_to_triangles(triangles[:, k], faces) for k in range(3)]
    return np.max(apart, axis=0) if len(triangles) else np.empty(0)


class _Over(NamedTuple):
    """Triangles that each lie over one face, and upper bounds (n,) on their distances to it."""

    triangles: np.ndarray
    above: np.ndarray


def _cut_over(triangles, faces, wider):
    """Cut triangles (n, 3, 3) along prisms over faces (n, 3, 3).

    The prisms are wider than the faces by a margin, because next to a convex edge some surface is
    over neither face. Extra planes keep the margin from growing at sharp corners.

    Returns
    -------
    over : _Over
        Parts inside the prisms. A triangle whose centroid is outside its prism has none: it is
        split into four.
    beside : ndarray, shape (m, 3, 3)
        The rest.
    """
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    planes = []
    for k in range(3):
        here, there = faces[:, k], faces[:, (k + 1) % 3]
        planes.append((here, _unit(np.cross(normal, there - here))))
        planes.append((here, _unit((there + faces[:, (k + 2) % 3]) / 2 - here)))
    middle = triangles.mean(axis=1)
    within = np.all([_dot(way, middle - place) > -wider for place, way in planes], axis=0)
    beside = [_quarters(triangles[~within])]
    inside, owner = triangles[within], np.flatnonzero(within)
    for place, way in planes:
        height = np.einsum("nk,njk->nj", way[owner], inside - place[owner, None]) + wider
        inside, out, active = _split(inside, height)
        owner = owner[active]
        beside.append(out)
    return _Over(inside, _corners_apart(inside, faces[owner])), np.concatenate(beside)


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _split(triangles, height):
    """Cut triangles (n, 3, 3) where a height, given at the corners (n, 3), is zero.

    Returns
    -------
    above, below : ndarray, shape (m, 3, 3)
    owner : ndarray
        For each triangle above, the index of the triangle from which it was cut.
    """
    high = height >= 0
    count = high.sum(axis=1)
    cut = np.flatnonzero((count == 1) | (count == 2))
    lone = np.where(count[cut] == 1, high[cut].argmax(axis=1), (~high[cut]).argmax(axis=1))
    order = (lone[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles[cut], order[:, :, None], 1).transpose(1, 0, 2)
    heights = np.take_along_axis(height[cut], order, 1)
    p, q = (a + (heights[:, 0] / (heights[:, 0] - heights[:, k]))[:, None] * (end - a)
            for k, end in ((1, b), (2, c)))  # fmt: skip
    tips = np.stack([a, p, q], axis=1)
    rests = [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
    up = count[cut] == 1
    whole = np.flatnonzero(count == 3)
    above = [triangles[whole], tips[up], *(rest[~up] for rest in rests)]
    owner = np.concatenate([whole, cut[up], cut[~up], cut[~up]])
    below = [triangles[count == 0], tips[~up], *(rest[up] for rest in rests)]
    return np.concatenate(above), np.concatenate(below), owner


def _quarters(triangles):
    """Split each triangle into four."""
    a, b, c = (triangles[:, k] for k in range(3))
    d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
    return np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])


def distance_to_triangles(points, triangles):
    """Return the distance (n,) of each point (n, 3) to the triangle (n, 3, 3) of the same index."""
    best = np.full(len(points), np.inf)
    for k in range(3):
        start, side = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        away = points - start
        length = np.maximum(_dot(side, side), 1e-300)
        along = np.clip(_dot(side, away) / length, 0, 1)[:, None]
        best = np.minimum(best, np.linalg.norm(away - along * side, axis=1))
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    away, normal = points - triangles[:, 0], np.cross(u, v)
    area = np.maximum(_dot(normal, normal), 1e-300)
    solid = _dot(normal, normal) > 1e-24 * _dot(u, u) * _dot(v, v)  # otherwise use only the edges
    s, t = _dot(np.cross(away, v), normal) / area, _dot(np.cross(u, away), normal) / area
    height = np.abs(_dot(normal, away)) / np.sqrt(area)
    inside = solid & (s >= 0) & (t >= 0) & (s + t <= 1)
    return np.where(inside, np.minimum(best, height), best)


def _dot(one, other):
    return np.einsum("nk,nk->n", one, other)

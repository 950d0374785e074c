"""How far two meshes lie apart at most: bounded by branch and bound, not sampled.

The distance to one triangle is a convex function, so on another triangle it is largest at a corner.
A triangle is therefore nowhere farther from a mesh than its three corners are from any one of the
mesh's faces; where that says too little, the triangle is cut into four.
"""

import numpy as np

from pandis.native.threads import SMALL, in_threads

#: The bound is at most so many times as large as the largest distance of a corner that was asked.
_LOOSE = 1.1
#: So small a distance (unit frame) is not divided any further.
_FLOOR = 1e-7
#: Triangles that are looked at before the bound is taken as it is.
_MOST = 4_000_000
#: Triangles that a thread looks at together: so few that it asks for their distances alone.
_CHUNK = SMALL - 1


def farthest(vertices, faces, engine):
    """Bound how far a surface lies from a mesh: the one-sided Hausdorff distance.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3), integer
        Of the surface.
    engine : pandis.geometry.distance.MeshDistance
        Of the mesh.

    Returns
    -------
    float
        No point of the surface is farther from the mesh (unit frame). Some point is at least nine
        tenths as far, unless the bound is below 1e-7, or cutting had to end: in planes of many
        small faces, none of which is near all corners of a triangle, the bound stays about as
        large as these faces.
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
        above, below = (np.concatenate(column) for column in zip(*parts, strict=True))
        least = max(least, float(below.max()))
        settled = above <= max(_LOOSE * least, _FLOOR)
        if looked + 4 * int((~settled).sum()) > _MOST:
            return max(most, float(above.max()))
        most = max(most, float(above[settled].max(initial=0.0)))
        left = _cut(left[~settled])
    return most


def _bounds(triangles, engine):
    """Return upper bounds (n,) of how far triangles (n, 3, 3) lie from a mesh, and lower ones."""
    centre = triangles.mean(axis=1)
    labels = engine.label(centre, ties=False, check=False)
    nearest = engine.vertices[engine.faces[labels.face]]
    apart = [distance_to_triangles(triangles[:, k], nearest) for k in range(3)]
    return np.max(apart, axis=0), np.abs(labels.distance)


def _cut(triangles):
    """Return the four quarters of each triangle."""
    a, b, c = (triangles[:, k] for k in range(3))
    d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
    return np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])


def distance_to_triangles(points, triangles):
    """Return the distance (n,) of each of the points (n, 3) to the triangle (n, 3, 3) beside it."""
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
    s, t = _dot(np.cross(away, v), normal) / area, _dot(np.cross(u, away), normal) / area
    height = np.abs(_dot(normal, away)) / np.sqrt(area)
    inside = (s >= 0) & (t >= 0) & (s + t <= 1)
    return np.where(inside, np.minimum(best, height), best)


def _dot(one, other):
    return np.einsum("nk,nk->n", one, other)

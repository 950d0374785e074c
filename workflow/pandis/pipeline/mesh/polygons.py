"""Triangulation of polygons.

Other mesh readers cut a polygon into a fan around its first corner. If the polygon is
not convex, such a fan overlaps itself and extends beyond the polygon.
"""

import numpy as np

from pandis.pipeline.mesh.holes import least_cost_triangles


def triangulate_polygons(vertices, polygons):
    """Cut polygons into triangles; the triangulation of least area covers each polygon once.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    polygons : list of list of int
        All vertex indices must be valid.

    Returns
    -------
    ndarray, shape (F, 3), int64
        Triangles, in the order of the polygons.
    """
    triangles = []
    for polygon in polygons:
        if len(polygon) == 3:
            triangles.append(polygon)
        elif len(polygon) > 3:
            triangles += _triangulate(vertices, polygon)
    return np.asarray(triangles, np.int64).reshape(-1, 3)


def _triangulate(vertices, polygon):
    points = vertices[polygon]
    n = len(polygon)
    fan = [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, n - 1)]
    cross = np.cross(points[1:-1] - points[0], points[2:] - points[0])
    around = cross @ cross.sum(axis=0)
    if (around > 0).all() or not np.isfinite(points).all():
        return fan  # convex as seen from the first corner: other readers make the same fan
    return [[polygon[i] for i in triangle] for triangle in least_cost_triangles(points)]

"""OBJ files with polygons, cut into triangles that cover them.

Mesh readers cut a polygon into a fan around its first corner; where it is not
convex, such a fan folds over itself and leaves the polygon.
"""

import re

import numpy as np

from pandis.mesh.holes import least_cost_triangles


def read_obj(path):
    """Read positions, polygons and the names of materials of an OBJ file.

    Parameters
    ----------
    path : str

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    names : list of (str or None)
        Of each face's material.

    Raises
    ------
    ValueError
        A line is malformed.
    """
    with open(path, encoding="utf-8", errors="replace") as stream:
        text = re.sub(r"\\\r?\n", " ", stream.read())
    vertices, polygons, names, name = [], [], [], None
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "usemtl":
            name = line.split(maxsplit=1)[1].strip() if len(words) > 1 else None
        elif words[0] == "f":
            corners = [int(word.split("/")[0]) for word in words[1:]]
            # negative: counted back from the last vertex so far
            polygons.append([c - 1 if c > 0 else len(vertices) + c for c in corners])
            names += [name] * max(len(corners) - 2, 0)
    vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
    return vertices, triangulate_polygons(vertices, polygons), names


def triangulate_polygons(vertices, polygons):
    """Cut polygons into triangles: the triangulation of least area covers the polygon once.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    polygons : list of list of int

    Returns
    -------
    ndarray, shape (F, 3), int64
        In the order of the polygons.
    """
    triangles = []
    for polygon in polygons:
        if len(polygon) == 3:
            triangles.append(polygon)
        elif len(polygon) > 3:
            if min(polygon) < 0 or max(polygon) >= len(vertices):
                raise ValueError("a face names a vertex that is not there")
            triangles += _triangulate(vertices, polygon)
    return np.asarray(triangles, np.int64).reshape(-1, 3)


def _triangulate(vertices, polygon):
    points = vertices[polygon]
    n = len(polygon)
    fan = [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, n - 1)]
    cross = np.cross(points[1:-1] - points[0], points[2:] - points[0])
    around = cross @ cross.sum(axis=0)
    if (around > 0).all() or not np.isfinite(points).all():
        return fan  # convex as seen from the first corner, as readers have it
    return [[polygon[i] for i in triangle] for triangle in least_cost_triangles(points)]

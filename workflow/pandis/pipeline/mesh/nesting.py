"""Nesting of a mesh's components, and the orientation that follows from it."""

import numpy as np

from pandis.pipeline.mesh.topology import crossing_faces
from pandis.pipeline.mesh.tree import MeshTree


def signed_volumes(vertices, faces, component, *, count):
    """Return the signed volume of each component (meaningful only if it is closed)."""
    corners = (vertices - vertices[faces[0, 0]])[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return np.bincount(component, volume, count)


def nesting_depth(vertices, faces, component, *, count):
    """Return, for each component, the number of other components that wholly enclose it.

    Components whose faces cross or touch overlap, so neither encloses the other.

    Parameters
    ----------
    vertices, faces : ndarray
        All components must be closed.
    component : ndarray, shape (F,)
    count : int

    Returns
    -------
    ndarray, shape (count,)
    """
    depth = np.zeros(count, np.int64)
    if count == 1:
        return depth
    order = np.argsort(component, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(component, minlength=count))])
    corners = vertices[faces[order]]
    low = np.minimum.reduceat(corners.min(axis=1), starts[:-1])
    high = np.maximum.reduceat(corners.max(axis=1), starts[:-1])
    crossing = component[crossing_faces(vertices, faces)]
    overlapping = {tuple(sorted(pair)) for pair in crossing.tolist()}
    some_vertex = vertices[faces[order[starts[:-1]], 0]]
    for outer in range(count):
        enclosed = np.flatnonzero((low > low[outer]).all(axis=1) & (high < high[outer]).all(axis=1))
        free = [k for k in enclosed if (min(k, outer), max(k, outer)) not in overlapping]
        if free:
            shell = faces[order[starts[outer] : starts[outer + 1]]]
            depth[free] += np.abs(MeshTree(vertices, shell).windings(some_vertex[free])) > 0.5
    return depth


def must_turn(volumes, depth):
    """Return a mask (count,) of the closed components with the wrong orientation.

    A component inside an even number of others bounds a solid and must have positive
    volume. One inside an odd number bounds a cavity and must have negative volume.
    """
    return (volumes > 0) != (depth % 2 == 0)

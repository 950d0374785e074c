"""Places of a mesh's faults, for people who look for them."""

import numpy as np

from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
from pandis.pipeline.mesh.topology import (
    crossing_faces,
    edges_of,
    nonmanifold_vertices,
    same_place,
    used_vertices,
)

#: Number of places that are listed for each kind of fault.
LISTED = 5


def fault_places(vertices, faces, diagnosis, *, listed=LISTED):
    """Return places (n, 3) of the faults of a mesh, by kind: at most ``listed`` of each.

    Inside-out components and odd winding numbers have no place of their own, and are left out.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    diagnosis : pandis.pipeline.mesh.diagnosis.Diagnosis
        Diagnosis of this mesh.
    """
    first = same_place(vertices)
    welded = np.ascontiguousarray(first[faces])
    edges = edges_of(welded)
    middles = vertices[welded].mean(axis=1)

    def along(mask):
        return vertices[edges.edges[np.flatnonzero(mask)]].mean(axis=1)

    def repeated():
        _, index, counts = np.unique(
            np.sort(welded, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        return middles[counts[index.reshape(-1)] > 1]

    def split():
        used = used_vertices(faces)
        return vertices[used[first[used] != used]]

    ways = {
        "split_vertices": split,
        "boundary_edges": lambda: along(edges.boundary),
        "nonmanifold_edges": lambda: along(edges.nonmanifold),
        "nonmanifold_vertices": lambda: vertices[nonmanifold_vertices(welded, edges)],
        "orientation_conflicts": lambda: along(edges.conflicts),
        "duplicate_faces": repeated,
        "degenerate_faces": lambda: middles[altitudes(vertices[welded])[0] <= FLAT],
        "self_intersections": lambda: middles[crossing_faces(vertices, welded)[:, 0]],
    }
    present = {name: way() for name, way in ways.items() if getattr(diagnosis, name)}
    return {name: _distinct(where)[:listed] for name, where in present.items()}


def _distinct(places):
    """Return places (n, 3) in order, each once."""
    _, first = np.unique(places, axis=0, return_index=True)
    return places[np.sort(first)]

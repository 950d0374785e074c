"""Open surfaces: which holes are too large to be filled unasked, and what to advise."""

import numpy as np

from pandis.mesh.deviation import Surface
from pandis.mesh.remesh import orient_by_sight
from pandis.mesh.topology import EdgeTable, components

#: With more of its area than this without anything behind it, a mesh is not advised to be capped.
SHEETS = 0.05


def large_holes(vertices, faces, small_hole, max_edges):
    """Return every hole that is not small, the widest first.

    A hole is small if its rim is at most ``small_hole`` times the diagonal of its
    component, and of at most ``max_edges`` edges.

    Returns
    -------
    list of {"edges": int, "length": float, "rim": float}
        Rim in diagonals of the component.
    """
    label, _ = components(faces)
    edges = EdgeTable(faces)
    large = []
    for part in np.unique(label[np.flatnonzero(edges.boundary[edges.edge_of]) // 3]):
        component = faces[label == part]
        size = float(np.linalg.norm(np.ptp(vertices[np.unique(component)], axis=0)))
        for hole in EdgeTable(component).holes(vertices):
            rim = hole["length"] / size if size else np.inf
            if rim > small_hole or hole["edges"] > max_edges:
                large.append(hole | {"rim": rim})
    return sorted(large, key=lambda hole: -hole["rim"])


def advice(vertices, faces, seed):
    """Return the sentence that names the option which fits an open surface."""
    front, behind = _windings_beside(vertices, faces, seed)
    sheet = np.maximum(front, behind) < 0.5
    if sheet.mean() <= SHEETS and (behind > 0.7).mean() > 0.5:
        return "To close the holes all the same, give this mesh the option `mesh: {open: cap}`"
    return (
        "Much of it is sheet, with nothing behind. To make it a wall of mesh.thickness, give this "
        "mesh the option `mesh: {open: thicken}`"
    )


def _windings_beside(vertices, faces, seed):
    """Return winding numbers before and behind points of the surface, its faces turned by sight."""
    surface = Surface(vertices, orient_by_sight(vertices, faces))
    rng = np.random.default_rng(seed)
    points, normals = surface.sample(4000, rng, np.ones(len(faces), bool))
    beside = 1e-3 * surface.diagonal * normals
    return surface.windings(points + beside), surface.windings(points - beside)

"""Open surfaces: which holes are too large to be filled unasked, and what to advise."""

import igl
import numpy as np

from pandis.pipeline.mesh.deviation import Surface
from pandis.pipeline.mesh.remesh import orient_by_sight
from pandis.pipeline.mesh.topology import EdgeTable, components

#: With more of its area than this without anything behind it, a mesh is not advised to be capped.
SHEETS = 0.05
#: Small open pieces are debris if all of them together have less than this share of the area.
DEBRIS = 0.01
#: What to write for a surface that has no inside.
THICKEN = "To make it a wall of mesh.thickness, give this mesh the option `mesh: {open: thicken}`"


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


def loose_pieces(vertices, faces, small_hole, max_edges):
    """Tell which faces belong to open pieces, with a large hole, that the rest does without.

    Parameters
    ----------
    vertices, faces : ndarray
    small_hole, max_edges
        As for `large_holes`.

    Returns
    -------
    debris, inside : ndarray, shape (F,)
        Small pieces beside the rest, as a scan leaves them; and those that lie wholly inside of
        what is closed.
    """
    label, count = components(faces)
    edges = EdgeTable(faces)
    open_ = np.zeros(count, bool)
    open_[label[np.flatnonzero(edges.boundary[edges.edge_of]) // 3]] = True
    for part in np.flatnonzero(open_):
        open_[part] = bool(large_holes(vertices, faces[label == part], small_hole, max_edges))
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share = np.bincount(label, area, count) / max(area.sum(), 1e-300)
    inside = np.zeros(count, bool)
    shell = np.ascontiguousarray(faces[~open_[label]], np.int64)
    if len(shell) and open_.any():
        middles = np.ascontiguousarray(corners[open_[label]].mean(axis=1))
        within = np.abs(igl.winding_number(np.ascontiguousarray(vertices), shell, middles)) > 0.5
        least = np.ones(count, bool)
        np.logical_and.at(least, label[open_[label]], within)
        inside = open_ & least
    small = np.sort(share[open_ & ~inside])
    # the small ones that are debris together
    most = small[: np.searchsorted(np.cumsum(small), DEBRIS)].max(initial=-1.0)
    debris = open_ & ~inside & (share <= most) & (np.arange(count) != share.argmax())
    if share[debris].sum() >= DEBRIS:
        debris[:] = False
    return debris[label], inside[label]


def advice(vertices, faces, seed):
    """Return the sentence that names the option which fits an open surface."""
    front, behind = _windings_beside(vertices, faces, seed)
    sheet = np.maximum(front, behind) < 0.5
    if sheet.mean() <= SHEETS and (behind > 0.7).mean() > 0.5:
        return "To close the holes all the same, give this mesh the option `mesh: {open: cap}`"
    return f"Much of it is sheet, with nothing behind. {THICKEN}"


def _windings_beside(vertices, faces, seed):
    """Return winding numbers before and behind points of the surface, its faces turned by sight."""
    surface = Surface(vertices, orient_by_sight(vertices, faces))
    rng = np.random.default_rng(seed)
    points, normals = surface.sample(4000, rng, np.ones(len(faces), bool))
    beside = 1e-3 * surface.diagonal * normals
    return surface.windings(points + beside), surface.windings(points - beside)

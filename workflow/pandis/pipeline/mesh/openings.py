"""Open surfaces: finds holes too large to fill by default, and advises on options."""

import numpy as np

from pandis.pipeline.mesh.deviation import Surface
from pandis.pipeline.mesh.remesh import orient_by_sight
from pandis.pipeline.mesh.topology import components, edges_of, used_vertices
from pandis.pipeline.mesh.tree import MeshTree

#: Capping is advised only if at most this share of the area has no solid behind it.
SHEETS = 0.05
#: Nor is it if more than this share of the area has a solid in front of it, as in piles of parts.
CROWDED = 0.2
#: Small open pieces are debris if their total share of the area is below this.
DEBRIS = 0.01
#: Advice for a surface that has no inside.
THICKEN = "To turn it into a wall of mesh.thickness, set `mesh: {open: thicken}` for this mesh"


def large_holes(vertices, faces, small_hole, *, max_edges):
    """Return every hole that is not small, in descending order of relative rim length.

    A hole is small if its rim is no longer than ``small_hole`` times its component's
    diagonal and has at most ``max_edges`` edges.

    Returns
    -------
    list of {"edges": int, "length": float, "rim": float}
        ``rim`` is the length divided by the component's diagonal.
    """
    label, _ = components(faces)
    edges = edges_of(faces)
    large = []
    for part in np.unique(label[np.flatnonzero(edges.boundary[edges.edge_of]) // 3]):
        component = faces[label == part]
        size = float(np.linalg.norm(np.ptp(vertices[used_vertices(component)], axis=0)))
        for hole in edges_of(component).holes(vertices):
            rim = hole["length"] / size if size else np.inf
            if rim > small_hole or hole["edges"] > max_edges:
                large.append(hole | {"rim": rim})
    return sorted(large, key=lambda hole: -hole["rim"])


def loose_pieces(vertices, faces, small_hole, *, max_edges):
    """Find the faces of open pieces that have a large hole and can be left out.

    Parameters
    ----------
    vertices, faces : ndarray
    small_hole, max_edges
        As in `large_holes`.

    Returns
    -------
    debris, inside : ndarray, shape (F,)
        Masks of the faces of small stray pieces, as in scans, and of the faces of pieces
        wholly inside closed parts.
    """
    label, count = components(faces)
    edges = edges_of(faces)
    open_ = np.zeros(count, bool)
    open_[label[np.flatnonzero(edges.boundary[edges.edge_of]) // 3]] = True
    for part in np.flatnonzero(open_):
        open_[part] = bool(
            large_holes(vertices, faces[label == part], small_hole, max_edges=max_edges)
        )
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share = np.bincount(label, area, count) / max(area.sum(), 1e-300)
    inside = np.zeros(count, bool)
    shell = faces[~open_[label]]
    if len(shell) and open_.any():
        middles = corners[open_[label]].mean(axis=1)
        within = np.abs(MeshTree(vertices, shell).windings(middles)) > 0.5
        least = np.ones(count, bool)
        np.logical_and.at(least, label[open_[label]], within)
        inside = open_ & least
    small = np.sort(share[open_ & ~inside])
    # area share of the largest piece that, summed with all smaller ones, stays below DEBRIS
    most = small[: np.searchsorted(np.cumsum(small), DEBRIS)].max(initial=-1.0)
    debris = open_ & ~inside & (share <= most) & (np.arange(count) != share.argmax())
    if share[debris].sum() >= DEBRIS:
        debris[:] = False
    return debris[label], inside[label]


def advice(vertices, faces, seed):
    """Return the value of `mesh.open` that suits an open surface, and a sentence about it."""
    front, behind = _windings_beside(vertices, faces, seed)
    sheet = np.maximum(front, behind) < 0.5
    crowded = (front > 0.3).mean() > CROWDED
    if sheet.mean() <= SHEETS and (behind > 0.7).mean() > 0.5 and not crowded:
        return "cap", "To close the holes nevertheless, set `mesh: {open: cap}` for this mesh"
    what = "has solid on both sides" if crowded else "is a sheet with no solid behind it"
    return "thicken", f"Much of the surface {what}. {THICKEN}"


def _windings_beside(vertices, faces, seed):
    """Return winding numbers in front of and behind surface points, after `orient_by_sight`."""
    surface = Surface(vertices, orient_by_sight(vertices, faces))
    rng = np.random.default_rng(seed)
    points, normals = surface.sample(4000, rng, np.ones(len(faces), bool))
    beside = 1e-3 * surface.diagonal * normals
    return surface.windings(points + beside), surface.windings(points - beside)

"""A mesh in a lattice: welded, with its open edges and its place among the nodes."""

from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.solid import FINENESS
from pandis.pipeline.mesh.topology import (
    compact,
    edges_of,
    face_keys,
    repeats_a_vertex,
    rotate_to_smallest,
)

#: Vertices in one cell of this share of the diagonal become one.
_WELD = 1e-6
#: Cells around the mesh. The lattice is shifted, so that its nodes lie on no plane of a part drawn
#: in round numbers.
MARGIN, _SHIFT = 4, np.array([0.0137, 0.0271, 0.0193])
#: Values of a cell's leading digits.
_DIGITS = 1024


class Frame(NamedTuple):
    """The lattice's place: a point p of the mesh lies at (p - origin) / cell."""

    origin: np.ndarray
    cell: float
    size: np.ndarray

    def to_cells(self, points):
        """Return points in cells."""
        return (points - self.origin) / self.cell

    def to_mesh(self, places):
        """Return places in mesh units."""
        return places * self.cell + self.origin


class Source(NamedTuple):
    """A mesh of which a solid is made.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), int64
        No two have the same vertices.
    open_edges : ndarray, shape (F, 3), bool
        Edges from corner k to k + 1 that have one face.
    doubled : ndarray, shape (F,), bool
        Faces that the mesh has in both orientations: walls seen from both sides.
    frame : Frame
    """

    vertices: np.ndarray
    faces: np.ndarray
    open_edges: np.ndarray
    doubled: np.ndarray
    frame: Frame

    @property
    def closed(self):
        """Whether there are no open edges."""
        return not self.open_edges.any()

    @property
    def diagonal(self):
        """Diagonal of the box, mesh units."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))


def source_of(vertices, faces, cells):
    """Return a mesh as a `Source` in a lattice of ``cells`` along its longest side.

    Raises
    ------
    PandisError
        No face has an area.
    """
    vertices, faces, doubled = _welded(vertices, faces)
    return Source(vertices, faces, _open_edges(faces), doubled, _frame(vertices, cells))


def _welded(vertices, faces):
    """Merge vertices in one place, and drop degenerate and repeated faces.

    Returns
    -------
    vertices, faces : ndarray
    doubled : ndarray
        Faces that were there in both orientations.
    """
    vertices, faces = compact(vertices, faces)
    extent = np.ptp(vertices, axis=0)
    if not (extent > 0).any():
        raise PandisError("the mesh is a point: it has no area")
    lattice = np.round((vertices - vertices.min(axis=0)) / (_WELD * np.linalg.norm(extent)))
    key = (lattice.astype(np.int64) * [1 << 42, 1 << 21, 1]).sum(axis=1)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    vertices, faces = vertices[first], index.reshape(-1)[faces]
    faces = faces[~repeats_a_vertex(faces)]
    if not len(faces):
        raise PandisError("no face has an area")
    turned = rotate_to_smallest(faces)
    _, first, index = np.unique(face_keys(faces), return_index=True, return_inverse=True)
    way = turned[:, 1] < turned[:, 2]
    both = np.zeros((len(first), 2), bool)
    both[index.reshape(-1), way.astype(int)] = True
    order = np.argsort(first)
    return vertices, faces[first[order]], both.all(axis=1)[order]


def _frame(vertices, cells):
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    # a cell and an origin of few digits: then placing a vertex takes no rounding
    share, power = np.frexp(float((high - low).max()) / (cells - 2 * MARGIN))
    cell = float(np.ldexp(np.ceil(share * _DIGITS) / _DIGITS, power))
    size = np.ceil((high - low) / cell).astype(np.int64) + 2 * MARGIN + 1
    origin = low / cell - ((size - (high - low) / cell) / 2 - _SHIFT)
    return Frame(np.round(origin * FINENESS) / FINENESS * cell, cell, size)


def _open_edges(faces):
    """Return a mask (F, 3) of the edges that have one face."""
    edges = edges_of(faces)
    return edges.boundary[edges.edge_of].reshape(-1, 3)

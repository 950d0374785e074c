"""Fewer faces for the same surface, none of which cross."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.solid import merged, reopened
from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
from pandis.pipeline.mesh.nesting import signed_volumes
from pandis.pipeline.mesh.topology import compact, crossing_faces, used_vertices

#: The mean distance of merged vertices, as a share of the tolerance: some are farther.
_MEAN = 0.5
#: Attempts at a surface without crossing faces, and the width of the surroundings that are locked.
_ATTEMPTS, _NEAR = 12, 2.0
#: Volume of the smallest component, cubic cells: rounding could turn a flatter one inside out.
_LEAST_VOLUME = 1e-6


def simplify(boundary, places, frame, *, tolerance, volume):
    """Return vertices (mesh units) and faces without self-intersections, simplified.

    Where simplified faces cross, the vertices around them are locked, and all that was merged with
    these is taken apart and simplified again: a small part of a curved surface, but all of a flat
    one. What still crosses in exact arithmetic goes back to the lattice.

    Parameters
    ----------
    boundary : pandis.engine.solid.Boundary
    places : ndarray, shape (V, 3)
        Where its vertices belong, cells. Changed in place.
    frame : pandis.pipeline.mesh.solid.source.Frame
    tolerance : float
        Largest distance of a vertex that is left out from the surface, cells.
    volume : ndarray, shape (P,)
        Volumes of the components, cubic cells.

    Raises
    ------
    PandisError
        Memory is short.
    """
    fine, vertices = boundary.faces, frame.to_mesh(places)
    locked = np.zeros(len(places), bool)
    into = np.arange(len(places), dtype=np.int32)
    changed, tolerance = np.ones(len(places), bool), tolerance * _MEAN
    for attempt in range(_ATTEMPTS):
        if tolerance:
            into, changed = _merged(
                into, fine, places, locked=locked, changed=changed, tolerance=tolerance
            )
        rows, faces = _faces(into, fine)
        # by the vertices that they come from: those that stand for them may be old
        bad = _bad_faces(faces, touching(changed, fine[rows]), places=places, vertices=vertices)
        turned = _turned(boundary.part, places, faces, volume=volume)
        bad = faces[np.concatenate([bad, np.flatnonzero(turned)])]
        if not len(bad):
            return compact(vertices, faces)
        around = near(places, used_vertices(bad))
        if attempt >= _ATTEMPTS // 3:
            around = near(places, around)
        back = around & locked & (places != boundary.places).any(axis=1)
        places[back] = boundary.places[back]
        vertices[back] = frame.to_mesh(places[back])
        locked |= around
        into, changed = reopened(places, fine, into=into, chosen=around, tolerance=tolerance)
    return compact(frame.to_mesh(boundary.places), fine.astype(np.int64))


def _merged(into, fine, places, *, locked, changed, tolerance):
    """Merge changed vertices, apart from locked ones.

    What was merged step by step cannot always be taken apart in one place only: where that leaves
    no manifold, more is taken apart.

    Returns
    -------
    into : ndarray, shape (V,), int32
        Which vertex stands for each.
    changed : ndarray, shape (V,), bool
        The vertices that may stand for others than before.

    Raises
    ------
    PandisError
        Memory is short, or the faces are no closed manifold from the beginning.
    """
    while True:
        _, faces = _faces(into, fine)
        step = merged(places, faces, locked=locked | ~changed, tolerance=tolerance)
        odd = step < 0
        if not odd.any():
            return step[into], changed
        if changed.all():
            raise PandisError("the surface of the solid is not closed and manifold")
        into, apart = reopened(places, fine, into=into, chosen=odd, tolerance=tolerance)
        if not (apart & ~changed).any():  # a guard: no such case is known
            apart[:], into = True, np.arange(len(places), dtype=np.int32)
        changed = changed | apart


def _faces(into, fine):
    """Return the rows of the faces that are left, and these faces (G, 3)."""
    a, b, c = (into[fine[:, k]] for k in range(3))
    rows = np.flatnonzero((a != b) & (b != c) & (c != a))
    return rows, np.stack([a[rows], b[rows], c[rows]], axis=1).astype(np.int64)


def _bad_faces(faces, chosen, *, places, vertices):
    """Return the chosen faces that are flat or cross others, and those others."""
    pairs = crossing_faces(*compact(vertices, faces), None if chosen.all() else chosen)
    chosen = np.flatnonzero(chosen)
    # in cells, where nothing underflows
    flat = chosen[altitudes(places[faces[chosen]])[0] <= FLAT]
    return np.concatenate([pairs.reshape(-1), flat])


def _turned(part, places, faces, *, volume):
    """Return a mask of the faces of components that are flat or inside out, and were not before."""
    label = part[faces[:, 0]]
    now = signed_volumes(places, faces, label, count=len(volume))
    least = np.minimum(_LEAST_VOLUME, np.abs(volume) / 2)  # some are tiny from the beginning
    return (now * np.sign(volume) < least)[label]


def touching(chosen, faces):
    """Return a mask of the faces with a chosen vertex."""
    return chosen[faces[:, 0]] | chosen[faces[:, 1]] | chosen[faces[:, 2]]


def near(places, chosen):
    """Return a mask of the vertices in and around the cells, `_NEAR` wide, of chosen ones.

    ``chosen`` is a mask, or has indices.
    """
    cells = (places / _NEAR).astype(np.int32) + 1
    marks = np.zeros(cells.max(axis=0) + 2, bool)
    marks[tuple(cells[chosen].T)] = True
    for axis in range(3):
        rows = np.moveaxis(marks, axis, 0)
        rows[1:-1] |= rows[:-2] | rows[2:]
    return marks[tuple(cells.T)]

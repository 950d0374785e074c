"""Snaps the vertices of a mesh to a lattice, and repairs its faces.

A lattice has 2^bits - 1 steps over [-0.9, 0.9] of the unit frame along each axis.
Rounding the vertices moves no point of the surface farther than the vertex that moved farthest.
"""

from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.engine.bvh import Bvh
from pandis.pipeline.mesh.topology import compact, equal_rows

#: Half the width of the lattice (unit frame). The longest side of a mesh spans the whole width.
HALF = UNIT_SIDE / 2
#: Maximum rounds of edge flips. Each round removes faces of zero area, but may leave others.
_ROUNDS = 50


class Snapped(NamedTuple):
    """A mesh on the lattice.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), int32
        Coordinates in lattice steps.
    faces : ndarray, shape (F, 3), int32
        Closed: every directed edge occurs as often as its reverse. No face has two equal corners.
    deviation : float
        No point of either surface is farther from the other than this (unit frame).
    turned : int
        Number of faces whose orientation is reversed.
    """

    vertices: np.ndarray
    faces: np.ndarray
    deviation: float
    turned: int


def step_of(bits):
    """Return the step of the lattice (unit frame)."""
    return 2 * HALF / ((1 << bits) - 1)


def to_unit(vertices, bits):
    """Return vertices (V, 3) of the lattice in the unit frame, float64."""
    return vertices * step_of(bits) - HALF


def snap(corners, faces, bits):
    """Snap a closed mesh to the lattice.

    Parameters
    ----------
    corners : ndarray, shape (V, 3), unit frame
        Within the lattice.
    faces : ndarray, shape (F, 3), integer
    bits : int

    Returns
    -------
    Snapped

    Raises
    ------
    PandisError
        No face is left: the mesh is thinner than a lattice step everywhere.
    """
    steps = np.rint((corners + HALF) / step_of(bits)).astype(np.int64)
    steps = np.clip(steps, 0, (1 << bits) - 1)
    moved = float(np.linalg.norm(to_unit(steps, bits) - corners, axis=1).max())
    before, after = _areas(corners, faces), _areas(steps, faces)
    turned = int((np.einsum("fk,fk->f", before, after) < 0).sum())
    _, first, merged = np.unique(
        steps @ (1 << np.array([40, 20, 0])), return_index=True, return_inverse=True
    )
    steps, faces = steps[first], merged.reshape(-1)[faces]
    faces, lost = _mend(steps, faces)
    if not len(faces):
        raise PandisError(
            f"on a lattice of {bits} bits nothing is left of the mesh: it is thinner than "
            f"{step_of(bits):.2g} of the unit frame everywhere; take more bits"
        )
    deviation = moved + _farthest(steps, lost, faces) * step_of(bits)
    steps, faces = compact(steps, faces)
    return Snapped(steps.astype(np.int32), faces.astype(np.int32), deviation, turned)


def _areas(vertices, faces):
    """Return twice the area vectors (F, 3) of faces."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _mend(vertices, faces):
    """Remove degenerate and paired faces.

    Returns
    -------
    faces : ndarray, shape (F, 3)
    lost : ndarray, shape (n, 3)
        Removed sheets, lines and points that lie on no remaining face.
    """
    sheets, lines = [], []
    for _ in range(_ROUNDS):
        faces = _cleaned(faces, sheets, lines)
        flat = np.flatnonzero((_areas(vertices, faces) == 0).all(axis=1))
        if not len(flat) or not _turn_edges(vertices, faces, flat):
            break
    else:
        faces = _cleaned(faces, sheets, lines)
    lines = np.concatenate(lines)
    count = len(vertices)
    touched, used = np.zeros((2, count), bool)
    touched[lines], used[faces] = True, True
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    known = edges[touched[edges].all(axis=1)] @ (count, 1)
    # a face with two equal corners is a line from that point to its third corner
    ends = lines.min(axis=1), lines.max(axis=1)
    on_edge = np.isin(ends[0] * count + ends[1], known) | np.isin(ends[1] * count + ends[0], known)
    on_edge |= (ends[0] == ends[1]) & used[ends[0]]
    return faces, np.concatenate([*sheets, lines[~on_edge]])


def _cleaned(faces, sheets, lines):
    """Append faces with equal corners to lines, opposite pairs to sheets; return the others."""
    equal = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    lines.append(faces[equal])
    faces = faces[~equal]
    unpaired = _without_pairs(faces)
    sheets.append(faces[~unpaired])
    return faces[unpaired]


def _without_pairs(faces):
    """Return a mask of the faces that remain after pairs of opposite faces cancel."""
    order = np.argsort(faces, axis=1)
    even = (np.diff(order, axis=1) % 3 == 1).all(axis=1)
    which = equal_rows(np.sort(faces, axis=1))
    count = int(which.max(initial=-1)) + 1
    ups, downs = (np.bincount(which[even == side], minlength=count) for side in (True, False))
    gone = np.minimum(ups, downs)
    group = 2 * which + even
    sorted_by = np.argsort(group, kind="stable")
    first = np.searchsorted(group[sorted_by], group[sorted_by])
    single = np.ones(len(faces), bool)
    single[sorted_by] = np.arange(len(faces)) - first >= gone[which[sorted_by]]
    return single


def _turn_edges(vertices, faces, flat):
    """Flip, in place, the longest edge of each flat face; return whether any was flipped."""
    across = {}
    # only a face that shares two corners with a flat face can be its neighbour
    beside = np.zeros(len(vertices), bool)
    beside[faces[flat]] = True
    beside = beside[faces].sum(axis=1) >= 2
    for index in np.flatnonzero(beside).tolist():
        face = faces[index].tolist()
        for k in range(3):
            across.setdefault((face[k], face[(k + 1) % 3]), []).append(index)
    touched, done = set(), False
    for index in flat.tolist():
        face = faces[index]
        sides = vertices[np.roll(face, -1)] - vertices[face]
        k = int(np.argmax((sides * sides).sum(axis=1)))
        start, end, middle = (int(face[(k + j) % 3]) for j in range(3))
        others = [other for other in across.get((end, start), ()) if other not in touched]
        if index in touched or not others:
            continue
        other = others[0]
        far = next(int(v) for v in faces[other] if v not in (start, end))
        if far == middle:
            continue
        touched |= {index, other}
        faces[index], faces[other] = (end, middle, far), (middle, start, far)
        done = True
    return done


def _farthest(vertices, lost, faces):
    """Return a bound on the distance of lost sheets from the remaining faces (steps).

    No point of a triangle is farther from its nearest corner than its longest side / √3.
    """
    if not len(lost):
        return 0.0
    points = vertices[lost].astype(np.float64)
    sides = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
    tree = Bvh(vertices.astype(np.float64), faces)
    apart = np.abs(tree.label(points.reshape(-1, 3), 0.0, check=False, feet=False).distance)
    return float((apart.reshape(-1, 3).max(axis=1) + sides / np.sqrt(3)).max())

"""Flips edges, so that no face lacks area or lies on its neighbour."""

import numpy as np

from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
from pandis.pipeline.mesh.topology import (
    edges_of,
    face_keys,
    folded_halves,
    opposite,
    rotate_to_smallest,
)

#: Maximum number of rounds: a flip can make another one necessary.
ROUNDS = 20
#: Unfolding flips an edge only if the area of its two faces falls below this share of what it was.
_SMALLER = 1 - 1e-9


def flip_flat_faces(vertices, faces, rounds=ROUNDS):
    """Flip the longest edge of each zero-area face, so that the face and its neighbour have area.

    The third corner of a flat face is on its longest edge. The two faces at that edge
    therefore cover the same surface before and after the flip.
    """
    for _ in range(rounds):
        flat = np.flatnonzero(altitudes(vertices[faces])[0] <= FLAT)
        if not len(flat):
            break
        corners = vertices[faces[flat]]
        longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
        flipped = _flip(faces, 3 * flat + longest)
        if flipped is faces:
            break
        faces = flipped
    return faces


def unfold(vertices, faces, rounds=ROUNDS):
    """Flip the edges at which a face lies on its neighbour, or drop the corner between the two.

    Each flip makes the area smaller, and changes the volume within rounding. Where the edge that it
    would make exists, and a vertex of the folded edge has only three faces, these are replaced by
    one. Two faces that are opposite then are dropped.

    Parameters
    ----------
    vertices, faces : ndarray
        No face uses a vertex twice.

    Returns
    -------
    ndarray
        The faces; the same array if none were folded, or if unfolding would open the mesh.
    """
    before = faces
    for _ in range(rounds):
        folded = folded_halves(vertices, faces)
        if not len(folded):
            break
        unfolded = _drop_corners(_flip(faces, folded[:, 0], vertices), vertices)
        if unfolded is faces:
            break
        faces = unfolded
    if faces is before:
        return before
    faces = _without_opposite(faces)
    return faces if (_faults(faces) <= _faults(before)).all() else before


def _faults(faces):
    edges = edges_of(faces)
    masks = edges.boundary, edges.nonmanifold, 2 * edges.forward != edges.uses
    return np.array([mask.sum() for mask in masks])


def _without_opposite(faces):
    """Return the faces without the pairs on the same three vertices that look opposite ways."""
    _, index, counts = np.unique(face_keys(faces), return_inverse=True, return_counts=True)
    rolled = rotate_to_smallest(faces)
    side = np.where(rolled[:, 1] < rolled[:, 2], 1, -1)
    index = index.reshape(-1)
    return faces[(counts != 2)[index] | (np.bincount(index, side) != 0)[index]]


def _flip(faces, halves, vertices=None):
    """Flip the edges of half-edges where that leaves the mesh manifold.

    Of edges with a common face only the first is flipped. With ``vertices``, an edge is flipped
    only if the area gets smaller. Returns the same array if none was flipped.
    """
    edges = edges_of(faces)
    partner = np.full(3 * len(faces), -1)
    pairs = edges.pairs()
    pairs = pairs[edges.runs_forward[pairs[:, 0]] != edges.runs_forward[pairs[:, 1]]]
    partner[pairs] = pairs[:, ::-1]
    halves = halves[partner[halves] >= 0]
    tips = np.stack([opposite(faces, half) for half in (halves, partner[halves])], axis=1)
    if vertices is not None:
        ends, tip, far = edges.directed[halves].T, *tips.T
        now = _area(vertices, *ends, tip) + _area(vertices, *ends, far)
        then = _area(vertices, ends[0], far, tip) + _area(vertices, far, ends[1], tip)
        halves, tips = (array[then < _SMALLER * now] for array in (halves, tips))
    flipped, touched, added = faces.copy(), set(), set()
    for half, other, (tip, far) in zip(
        halves.tolist(), partner[halves].tolist(), tips.tolist(), strict=True
    ):
        pair, edge = {half // 3, other // 3}, (min(tip, far), max(tip, far))
        if pair & touched or tip == far or edge in added or edges.has(edge):
            continue
        a, b = edges.directed[half]
        flipped[half // 3], flipped[other // 3] = (a, far, tip), (far, b, tip)
        touched |= pair
        added.add(edge)
    return flipped if touched else faces


def _area(vertices, *corners):
    """Return the areas of faces whose corners have these indices, each (n,)."""
    return altitudes(vertices[np.stack(corners, axis=1)])[1]


def _drop_corners(faces, vertices):
    """Replace the three faces of a vertex at a folded edge by one, if it has no others."""
    halves = folded_halves(vertices, faces)
    if not len(halves):
        return faces
    ends = np.unique(edges_of(faces).directed[halves.reshape(-1)])
    corners = np.flatnonzero(np.isin(faces.reshape(-1), ends))
    order = corners[np.argsort(faces.reshape(-1)[corners], kind="stable")]
    rows, touched = faces.copy(), set()
    starts = np.flatnonzero(np.diff(faces.reshape(-1)[order], prepend=-1))
    for start, end in zip(starts, [*starts[1:], len(order)], strict=True):
        around = order[start:end]
        if end - start != 3 or touched & set((around // 3).tolist()):
            continue
        after, before = (rows.reshape(-1)[around - around % 3 + (around + k) % 3] for k in (1, 2))
        following = dict(zip(after.tolist(), before.tolist(), strict=True))
        first = int(after[0])
        rim = [first, following[first], following.get(following[first], -1)]
        if following.get(rim[2], -1) != first or len(set(rim)) != 3:
            continue
        areas = altitudes(vertices[np.array([*faces[around // 3], rim])])[1]
        if areas[3] >= _SMALLER * areas[:3].sum():
            continue
        rows[around // 3] = [rim, [-1, -1, -1], [-1, -1, -1]]
        touched |= set((around // 3).tolist())
    return rows[rows[:, 0] >= 0] if touched else faces

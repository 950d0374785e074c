"""Flips edges, so that no face lacks area or lies on its neighbour."""

import numpy as np

from pandis.pipeline.mesh.diagnosis import FLAT, altitudes
from pandis.pipeline.mesh.topology import edges_of, folded_halves, opposite

#: Flips of one edge can be followed by others at most so often.
ROUNDS = 20


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

    What the two cover twice encloses nothing. A flip leaves what they cover once, so the area
    decreases with each. Where the edge that a flip would make exists, and a vertex of the folded
    edge has only three faces, these are replaced by one.

    Returns
    -------
    ndarray
        The faces; the same array if none were folded.
    """
    for _ in range(rounds):
        folded = folded_halves(vertices, faces)
        unfolded = _drop_corners(_flip(faces, folded[:, 0]), vertices) if len(folded) else faces
        if unfolded is faces:
            break
        faces = unfolded
    return faces


def _flip(faces, halves):
    """Flip the edges of half-edges where that leaves the mesh manifold.

    Of edges with a common face only the first is flipped. Returns the same array if none was.
    """
    edges = edges_of(faces)
    partner = np.full(3 * len(faces), -1)
    pairs = edges.pairs()
    pairs = pairs[edges.runs_forward[pairs[:, 0]] != edges.runs_forward[pairs[:, 1]]]
    partner[pairs] = pairs[:, ::-1]
    halves = halves[partner[halves] >= 0]
    tips = np.stack([opposite(faces, half) for half in (halves, partner[halves])], axis=1)
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
        rows[around // 3] = [rim, [-1, -1, -1], [-1, -1, -1]]
        touched |= set((around // 3).tolist())
    return rows[rows[:, 0] >= 0] if touched else faces

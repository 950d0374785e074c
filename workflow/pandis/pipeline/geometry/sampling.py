"""Points on a surface, and the probe sets on which errors are measured.

Points are stratified by area along a space-filling order of the faces. Probe
sets are also blue noise: their points are evenly spaced. Every point can be
recomputed from the seed, its face and its barycentric coordinates.
"""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pandis.base.streams import generator

#: The points of each probe set are at most this far below the surface (unit frame).
PROBE_DEPTHS = {"shallow": 0.01, "deep": 0.04}
#: A face's weight for bent sampling is its mean curvature times this length (unit frame).
BEND_LENGTH = 0.05
#: Largest weight of a face for bent sampling; the weight of a flat face is 1.
BEND_FACTOR = 8.0
#: Number of points on which fields and networks are sized to meet a given error.
HELD_OUT = 20_000
#: Number of candidates per point of a blue-noise set.
_CANDIDATES = 4


class Surface:
    """The surface of a mesh, from which points are drawn.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), unit frame
    faces : ndarray, shape (F, 3)
    engine : object, optional
        If given, points are moved onto its zero level. It is meant for closed-form
        shapes, because their tessellations are only approximate.
    """

    def __init__(self, vertices, faces, engine=None):
        corners = vertices[faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1)
        self.vertices, self.faces, self.corners = vertices, faces, corners
        self.normals = cross / np.maximum(length, 1e-300)[:, None]
        self.areas = length / 2
        self.order = np.argsort(_morton(corners.mean(axis=1)), kind="stable")
        self.share = self._cumulative(self.areas)
        self.engine = engine

    def draw(self, count, rng, start=0, *, total=None, bent=False):
        """Draw points stratified by area.

        Parameters
        ----------
        count : int
        rng : numpy.random.Generator
        start, total : int, optional
            Draw ``count`` points of a set of ``total``, beginning at index ``start``.
        bent : bool
            Draw more points where the surface bends.

        Returns
        -------
        points, normals : ndarray, shape (count, 3)
        face : ndarray, shape (count,), int32
        barycentrics : ndarray, shape (count, 2), float32
            Weights of the face's second and third corner.
        """
        share = self.bent_share if bent else self.share
        position = (start + np.arange(count) + rng.random(count)) / (total or count)
        rank = np.minimum(np.searchsorted(share, position, side="right"), len(self.order) - 1)
        face = self.order[rank]
        root, turn = np.sqrt(rng.random(count)), rng.random(count)
        weights = np.stack([root * (1 - turn), root * turn], axis=1).astype(np.float32)
        points, normals = self.at(face, weights)
        return points, normals, face.astype(np.int32), weights

    def at(self, face, barycentrics):
        """Return the points and outward normals at faces (n,) and barycentrics (n, 2)."""
        b = barycentrics.astype(np.float64)
        weights = np.concatenate([1 - b.sum(axis=1, keepdims=True), b], axis=1)
        points = np.einsum("ij,ijk->ik", weights, np.take(self.corners, face, axis=0))
        if self.engine is None:
            return points, np.take(self.normals, face, axis=0)
        for _ in range(2):
            distance, normal = self.engine.distance_and_normal(points)
            points = points - distance[:, None] * normal
        return points, normal

    @cached_property
    def bent_share(self):
        """Cumulative share of area times bending weight, over the faces sorted by `order`."""
        return self._cumulative(self.areas * bending(self))

    def _cumulative(self, weight):
        cumulative = np.cumsum(weight[self.order])
        return cumulative / cumulative[-1]


def bending(surface):
    """Return each face's weight (F,) for drawing more points where the surface bends.

    The weight is proportional to the discrete mean curvature: the sum of the angles to the face's
    neighbours, weighted by edge length, divided by its area. It is clipped to [1, `BEND_FACTOR`].
    """
    faces = surface.faces
    halves = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(halves.T)
    same = (np.diff(halves[order], axis=0) == 0).all(axis=1)
    one, other = order[:-1][same], order[1:][same]
    length = np.linalg.norm(
        surface.corners[one // 3, one % 3] - surface.corners[one // 3, (one + 1) % 3], axis=1
    )
    chord = np.linalg.norm(surface.normals[one // 3] - surface.normals[other // 3], axis=1)
    bend = 2 * np.arcsin(np.minimum(chord / 2, 1)) * length / 2
    total = np.bincount(one // 3, bend, len(faces)) + np.bincount(other // 3, bend, len(faces))
    return np.clip(total / np.maximum(surface.areas, 1e-300) * BEND_LENGTH, 1.0, BEND_FACTOR)


def blue_noise(surface, count, rng):
    """Draw blue noise by sample elimination (Yuksel 2015).

    Four times ``count`` candidates are drawn, and the most crowded are removed first. Only
    neighbours on the same side of a wall count. Yuksel removes one candidate at a time; here,
    each round removes every candidate in the most crowded tenth that is at least as crowded as all
    its neighbours.

    Returns
    -------
    points, normals, face, barycentrics
        As `Surface.draw`.
    """
    drawn = surface.draw(_CANDIDATES * count, rng)
    points, normals = drawn[:2]
    radius = np.sqrt(surface.areas.sum() / (2 * np.sqrt(3) * count))
    pairs = cKDTree(points).query_pairs(2 * radius, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0]
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    closeness = (1 - apart / (2 * radius)) ** 8
    alive, left = np.ones(len(points), bool), len(points) - count
    crowding = _sums(pairs, closeness, len(points))
    while left:
        worst = np.zeros(len(points))
        np.maximum.at(worst, pairs[:, 0], crowding[pairs[:, 1]])
        np.maximum.at(worst, pairs[:, 1], crowding[pairs[:, 0]])
        tenth = np.partition(crowding[alive], -(alive.sum() // 10 + 1))[-(alive.sum() // 10 + 1)]
        go = np.flatnonzero(alive & (crowding >= worst) & (crowding >= tenth))
        go = go[np.argsort(-crowding[go], kind="stable")][:left]
        alive[go] = False
        left -= len(go)
        gone = ~alive[pairs]
        crowding -= _sums(pairs, np.where(gone.any(axis=1), closeness, 0.0), len(points))
        crowding[~alive] = 0
        free = ~gone.any(axis=1)
        pairs, closeness = pairs[free], closeness[free]
    return tuple(column[alive] for column in drawn)


def _sums(pairs, values, count):
    return np.bincount(pairs[:, 0], values, count) + np.bincount(pairs[:, 1], values, count)


def probes(body, count, seed):
    """Return the shallow and the deep probe set, with exact distances and normals.

    Points are area-uniform blue noise on the surface, moved inward along the normal by
    depths uniform in [0, 0.01] (``shallow``) or [0, 0.04] (``deep``).

    Returns
    -------
    dict of str to (points, distance, normal)
        Exact values, unit frame, float64.
    """
    sets = {}
    for index, (name, deepest) in enumerate(PROBE_DEPTHS.items()):
        rng = generator(seed, index)
        points, normals, _, _ = blue_noise(body.surface, count, rng)
        depth = rng.permutation((np.arange(count) + rng.random(count)) / count) * deepest
        points = points - depth[:, None] * normals
        sets[name] = (points, *body.distance.distance_and_normal(points))
    return sets


def _morton(points):
    """Return the Morton codes of points, 21 bits per axis."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = ((points - low) / np.maximum(high - low, 1e-300) * (2**21 - 1)).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for axis in range(3):
        bits = cells[:, axis]
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code

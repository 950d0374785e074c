"""Closed-form shapes: exact signed distance and normal, and a tessellation."""

from dataclasses import dataclass

import numpy as np

from pandis.base.arrays import Points, Values
from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.sourcing import ANALYTIC, SHAPE_NAMES, source_fault

_TINY = 1e-300


def _unit(vectors, fallback):
    """Normalise vectors (n, 3); zero vectors become ``fallback``."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > _TINY, vectors / np.maximum(length, _TINY), fallback)


@dataclass(frozen=True)
class Sphere:
    """A sphere at the origin, as in section 3.4 of the paper."""

    radius: float = 1.0

    @property
    def half_extent(self):
        """Half the side lengths of the bounding box."""
        return np.full(3, self.radius)

    def distance_and_normal(self, points: Points) -> tuple[Values, Points]:
        """Return signed distance (n,) and unit normal (n, 3) at points (n, 3)."""
        distance = np.linalg.norm(points, axis=1) - self.radius
        return distance, _unit(points, [0.0, 0.0, 1.0])

    def tessellation(self):
        """Return vertices (V, 3) and faces (F, 3) of a subdivided, axis-aligned octahedron."""
        return _subdivided_octahedron(6, self)


@dataclass(frozen=True)
class Torus:
    """A torus around the z axis."""

    ring: float = 1.0
    tube: float = 0.4

    @property
    def half_extent(self):
        """Half the side lengths of the bounding box."""
        return np.array([self.ring + self.tube, self.ring + self.tube, self.tube])

    def distance_and_normal(self, points: Points) -> tuple[Values, Points]:
        """Return signed distance (n,) and unit normal (n, 3) at points (n, 3)."""
        flat = points * [1.0, 1.0, 0.0]
        centre = self.ring * _unit(flat, [1.0, 0.0, 0.0])
        offset = points - centre
        return np.linalg.norm(offset, axis=1) - self.tube, _unit(offset, [0.0, 0.0, 1.0])

    def tessellation(self, around=192, across=96):
        """Return vertices (V, 3) and faces (F, 3)."""
        phi, theta = np.meshgrid(
            2 * np.pi * np.arange(around) / around,
            2 * np.pi * np.arange(across) / across,
            indexing="ij",
        )
        rho = self.ring + self.tube * np.cos(theta)
        vertices = np.stack([rho * np.cos(phi), rho * np.sin(phi), self.tube * np.sin(theta)], -1)
        i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
        i1, j1 = (i + 1) % around, (j + 1) % across
        a, b, c, d = (p * across + q for p, q in ((i, j), (i1, j), (i1, j1), (i, j1)))
        faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
        return vertices.reshape(-1, 3), faces


@dataclass(frozen=True)
class Box:
    """An axis-aligned box at the origin."""

    half: tuple[float, float, float] = (1.0, 0.7, 0.5)

    @property
    def half_extent(self):
        """Half the side lengths of the bounding box."""
        return np.array(self.half)

    def distance_and_normal(self, points: Points) -> tuple[Values, Points]:
        """Return signed distance (n,) and unit normal (n, 3) at points (n, 3)."""
        excess = np.abs(points) - self.half
        out = np.maximum(excess, 0)
        outside = np.linalg.norm(out, axis=1)
        distance = outside + np.minimum(excess.max(axis=1), 0)
        face = np.zeros_like(points)
        face[np.arange(len(points)), excess.argmax(axis=1)] = 1
        sign = np.where(points < 0, -1.0, 1.0)
        return distance, sign * np.where(outside[:, None] > 0, _unit(out, face), face)

    def tessellation(self, cuts=32):
        """Return vertices (V, 3) and faces (F, 3)."""
        return _welded_patches(self._patch, cuts)

    def _patch(self, axis, side, uv):
        """Map [-1, 1]² to one side of the box, counter-clockwise as seen from outside."""
        (u, v), point = uv, np.empty((len(uv[0]), 3))
        point[:, axis] = side
        point[:, (axis + 1) % 3] = u if side > 0 else v
        point[:, (axis + 2) % 3] = v if side > 0 else u
        return point * self.half


@dataclass(frozen=True)
class Capsule:
    """A cylinder along the z axis with hemispherical ends."""

    radius: float = 0.4
    half_length: float = 0.6

    @property
    def half_extent(self):
        """Half the side lengths of the bounding box."""
        return np.array([self.radius, self.radius, self.half_length + self.radius])

    def distance_and_normal(self, points: Points) -> tuple[Values, Points]:
        """Return signed distance (n,) and unit normal (n, 3) at points (n, 3)."""
        axis = np.clip(points[:, 2], -self.half_length, self.half_length)
        offset = points - axis[:, None] * [0.0, 0.0, 1.0]
        return np.linalg.norm(offset, axis=1) - self.radius, _unit(offset, [1.0, 0.0, 0.0])

    def tessellation(self, around=128, cap=32):
        """Return vertices (V, 3) and faces (F, 3)."""
        polar = np.pi / 2 * np.arange(1, cap + 1) / cap
        top = np.stack([np.sin(polar), np.cos(polar)], 1) * self.radius + [0, self.half_length]
        profile = np.concatenate([top, (top * [1, -1])[::-1]])
        phi = 2 * np.pi * np.arange(around) / around
        rings = np.stack(
            [
                profile[:, :1] * np.cos(phi),
                profile[:, :1] * np.sin(phi),
                np.repeat(profile[:, 1:], around, axis=1),
            ],
            -1,
        )
        vertices = np.concatenate(
            [rings.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]] * self.half_extent]
        )
        j = np.arange(around)
        nxt, faces = (j + 1) % around, []
        for ring in range(len(profile) - 1):
            a, b = ring * around, (ring + 1) * around
            faces += [np.stack([a + j, b + j, b + nxt], 1), np.stack([a + j, b + nxt, a + nxt], 1)]
        last = (len(profile) - 1) * around
        pole = np.full(around, len(vertices) - 2)
        faces += [np.stack([pole, j, nxt], 1), np.stack([pole + 1, last + nxt, last + j], 1)]
        return vertices, np.concatenate(faces)


SHAPES = dict(zip(SHAPE_NAMES, (Sphere(), Torus(), Box(), Capsule()), strict=True))


def find_shape(name):
    """Return the closed-form shape of ``analytic:{name}``.

    Raises
    ------
    PandisError
        There is no shape of this name.
    """
    if fault := source_fault(ANALYTIC + name):
        raise PandisError(fault)
    return SHAPES[name]


def _subdivided_octahedron(level, sphere):
    vertices = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
    )
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    for _ in range(level):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = _unit(vertices[unique].mean(axis=1), [0.0, 0.0, 1.0])
        ab, bc, ca = index.reshape(-1, 3).T + len(vertices)
        a, b, c = faces.T
        faces = np.concatenate(
            [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        vertices = np.concatenate([vertices, middle])
    return vertices * sphere.radius, faces


def _welded_patches(patch, cuts):
    """Weld six square patches of ``cuts``² quads into one closed mesh."""
    grid = np.linspace(-1, 1, cuts + 1)
    u, v = (g.ravel() for g in np.meshgrid(grid, grid, indexing="ij"))
    corner = np.arange((cuts + 1) ** 2).reshape(cuts + 1, cuts + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    quads = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    sides = [(axis, side) for axis in range(3) for side in (1.0, -1.0)]
    points = np.concatenate([patch(axis, side, (u, v)) for axis, side in sides])
    faces = np.concatenate([quads + i * len(u) for i in range(len(sides))])
    vertices, index = np.unique(points, axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[faces]

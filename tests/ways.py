"""Ways of a probe that is pressed, slid and led away, and the shapes with which that is hard."""

from dataclasses import dataclass

import numpy as np
import trimesh
from igl.copyleft.cgal import mesh_boolean
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

#: Of a block, mm; how fast a probe goes (mm/s).
BLOCK, SPEED = 100.0, 200.0
#: A cone's angles to its axis, the widest gap between two of its edges.
TILTS, GAP = (0.35, 1.2), 2.6
FRICTIONS, BUDGETS, TICKS = (0.0, 0.3, 1.0), (8, 12, 24), (2e-4, 5e-4, 1e-3, 2e-3, 5e-3)


def _cut(part):
    """Return a block without a part, whose tip lies in its middle."""
    block = trimesh.creation.box((BLOCK, BLOCK, BLOCK)).apply_translation((0, 0, 10))
    arrays = [(np.asarray(m.vertices, float), np.asarray(m.faces, np.int64)) for m in (block, part)]
    vertices, faces, _ = mesh_boolean(*arrays[0], *arrays[1], "minus")
    return trimesh.Trimesh(vertices, faces, process=False)


def _hull(points):
    mesh = trimesh.Trimesh(points, ConvexHull(points).simplices, process=False)
    mesh.fix_normals()
    return mesh


def corner(walls):
    """Return what makes a block with a corner of so many concave walls, and places in it."""

    def make(rng):
        while True:
            around = np.sort(rng.uniform(0, 2 * np.pi, walls))
            if np.diff(around, append=around[0] + 2 * np.pi).max() > GAP:
                continue
            tilt = rng.uniform(*TILTS)
            edges = np.column_stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around),
                                     np.full(walls, np.cos(tilt))])  # fmt: skip
            mesh = _cut(_hull(np.concatenate([np.zeros((1, 3)), 1.2 * BLOCK * edges])))
            if mesh.is_watertight:
                return mesh, lambda rng: (rng.normal(0, 1, 3), np.array([0, 0, 1.0]))

    return make


def groove(rng):
    """Return a block with a groove of 15 to 90 degrees."""
    half, length = np.tan(np.radians(rng.uniform(7.5, 45))), 2 * BLOCK
    ends = [(x, y, z) for x in (-length, length) for y, z in ((0, 0), (-half, 1), (half, 1))]
    mesh = _cut(_hull(np.array(ends) * (1, 0.7 * BLOCK, 0.7 * BLOCK)))
    return mesh, lambda rng: (rng.normal(0, 1, 3) * (20, 1, 1), np.array([0, 0, 1.0]))


def slit(rng):
    """Return a block with a slit of 0.5 to 3 mm, 30 mm deep."""
    wide = rng.uniform(0.5, 3)
    part = trimesh.creation.box((2 * BLOCK, wide, 90)).apply_translation((0, 0, 75))
    mesh = _cut(part)
    return mesh, lambda rng: (rng.normal(0, 1, 3) * (10, 1, 1) + (0, 0, 60), np.array([0, 0, 1.0]))


def needle(rng):
    """Return a needle of 100 mm."""
    mesh = trimesh.creation.cone(rng.uniform(0.5, 2), BLOCK, sections=24)
    return mesh, lambda rng: (rng.normal(0, 0.5, 3) + (0, 0, rng.uniform(50, 100)), None)


def torus(_):
    """Return a torus of 100 mm."""
    mesh = trimesh.creation.torus(35, 15, major_sections=96, minor_sections=48)
    return mesh, lambda rng: (rng.normal(0, 30, 3), None)


SHAPES = {f"corner of {n}": corner(n) for n in range(3, 9)}
SHAPES |= {"groove": groove, "slit": slit, "needle": needle, "torus": torus}


@dataclass(frozen=True)
class Way:
    """How a probe goes on an object, mm in its frame.

    Attributes
    ----------
    foot, outward : ndarray, shape (3,)
        A place of the surface, and a direction that leads away from there.
    height : float
        Above that place, where it begins.
    aside : ndarray, shape (k, 3)
        From there, where it goes one after the other, the first of them pressed in.
    radius : float
        Of the probe, a share of the largest.
    friction, dt : float
    budget : int
    moving : bool
        Whether the object moves.
    """

    foot: np.ndarray
    outward: np.ndarray
    height: float
    aside: np.ndarray
    radius: float
    friction: float
    budget: int
    dt: float
    moving: bool

    def path(self, radius):
        """Return the positions (n, 3) of a probe of a radius (mm), one for each tick."""
        begin = self.foot + (radius + self.height) * self.outward
        places = np.concatenate([begin[None], self.foot + self.aside])
        parts = [begin[None]]
        for a, b in zip(places[:-1], places[1:], strict=True):
            count = max(1, int(np.ceil(np.linalg.norm(b - a) / (SPEED * self.dt))))
            parts.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
        return np.concatenate(parts)

    def turns(self, count):
        """Yield poses (4, 4), metres, of an object that swings by 5 degrees and 5 mm."""
        for tick in range(count):
            phase = 2 * np.pi * tick * self.dt
            pose = np.eye(4)
            turned = np.radians(5) * np.sin(phase) * self.outward
            pose[:3, :3] = Rotation.from_rotvec(turned).as_matrix()
            pose[:3, 3] = 5e-3 * np.sin(phase) * np.array([0.6, 0.8, 0])
            yield pose


def draw(solid, where, count, rng, mm):
    """Return ways (count) on a solid of the unit frame, mm of 1 / `mm` in its frame.

    Parameters
    ----------
    solid : oracle.Solid
    where : tuple or None
        What gives places of the shape as it was made, its rotation, and its frame.
    """
    ways, surface = [], solid.points(10_000)
    while len(ways) < count:
        outward = None
        if where is None:
            foot = surface[rng.integers(len(surface))]
        else:
            places, turn, frame = where
            foot, outward = places(rng)
            foot = frame.to_unit((turn @ foot)[None])[0]
        distance, normal = (column[0] for column in solid.distance(foot[None]))
        foot = foot - distance * normal
        outward = normal if outward is None else turn @ outward
        largest = rng.choice([0, 0, rng.random()])
        deep, turns = rng.uniform(0.3, 3), rng.integers(1, 3)
        aside = [-deep * outward + rng.normal(0, 0.5, 3)]
        for _ in range(turns):
            aside.append(aside[-1] + rng.normal(0, rng.choice([1, 3]), 3))
        if rng.random() < 0.5:
            aside.append(aside[-1] + rng.uniform(2, 20) * outward + rng.normal(0, 1, 3))
        heights = 3 * 1.3 ** np.arange(12)
        starts = foot + mm * (heights + 5 * largest)[:, None] * outward
        free = np.flatnonzero(solid.distance(starts)[0] > (5 * largest + 1) * mm)
        if len(free):
            ways.append(Way(
                foot / mm, outward, heights[free[0]], np.array(aside), largest,
                rng.choice(FRICTIONS), int(rng.choice(BUDGETS)), rng.choice(TICKS),
                rng.random() < 1 / 8,
            ))  # fmt: skip
    return ways

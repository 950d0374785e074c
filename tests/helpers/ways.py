"""Ways of a probe that is pressed, slid and led away, and the shapes with which that is hard."""

import itertools
from collections import Counter
from dataclasses import dataclass

import numpy as np
import trimesh
from igl.copyleft.cgal import mesh_boolean
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from oracle import walk
from pandis.base.frame import UNIT_SIDE
from pandis.runtime.contact import Material, NativeContact
from pandis.runtime.scene import Placed

#: Of a block, mm; how fast a probe goes (mm/s).
BLOCK, SPEED = 100.0, 200.0
#: A cone's angles to its axis, the widest gap between two of its edges.
TILTS, GAP = (0.35, 1.2), 2.6
FRICTIONS, BUDGETS, TICKS = (0.0, 0.3, 1.0), (8, 12, 24), (2e-4, 5e-4, 1e-3, 2e-3, 5e-3)
#: A millimetre of 100 in the unit frame; N/m; one of so many objects moves.
MM, STIFFNESS, MOVING = UNIT_SIDE / 100, 400.0, 8
#: How near the proxy has to come to where the walk leads, and what does not count as deep (mm).
NEAR, DEEP = 0.05, 0.05
#: By which friction's cone may be wider (radians): on a ridge any plane between its faces holds.
SLANT = 0.1
#: Seconds for which a proxy may go too slowly; after how many more it is left behind.
DUE, LATER = 0.05, 2.0
#: A straight way is free if the probe goes nowhere this much (mm) deeper than at its beginning.
GRAZED, ALONG = 1e-3, 20_001
#: Few looks per second excuse a slow proxy: it has to go this far (m) for each look, and `DUE` is
#: the time of this many looks, if that is longer.
STRIDE, LOOKS = 4e-6, 600


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


def waves(rng):
    """Return a ball of 70 to 90 mm under waves of 20 mm, in 82,000 triangles."""
    ball = trimesh.creation.icosphere(6)
    along = rng.normal(0, 1, (12, 3))
    along *= 32 / np.linalg.norm(along, axis=1, keepdims=True)
    high = np.sin(ball.vertices @ along.T + rng.uniform(0, 2 * np.pi, 12)).sum(1, keepdims=True)
    ball.vertices *= BLOCK * (0.4 + 0.015 * high)
    return ball, lambda rng: (rng.normal(0, 0.4 * BLOCK, 3), None)


SHAPES = {f"corner of {n}": corner(n) for n in range(3, 9)}
SHAPES |= {"groove": groove, "slit": slit, "needle": needle, "torus": torus, "waves": waves}


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
        for a, b in itertools.pairwise(places):
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


def draw(solid, where, count, rng):
    """Return ways (count) on a solid of the unit frame.

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
        starts = foot + MM * (heights + 5 * largest)[:, None] * outward
        free = np.flatnonzero(solid.distance(starts)[0] > (5 * largest + 1) * MM)
        if len(free):
            ways.append(Way(
                foot / MM, outward, heights[free[0]], np.array(aside), largest,
                rng.choice(FRICTIONS), int(rng.choice(BUDGETS)), rng.choice(TICKS),
                rng.random() < 1 / MOVING,
            ))  # fmt: skip
    return ways


class Followed:
    """A contact along a way; lengths are those of the unit frame, in the object's frame.

    Attributes
    ----------
    radius : float
    probe : ndarray, shape (3,)
        Where it ends.
    proxies : list of ndarray, shape (n, 3)
    over : int
        Ticks in which a force changed by more than it may.
    """

    def __init__(self, field, way, largest):
        self.way, self.over, self.proxies, self.radius = way, 0, [], way.radius * largest * MM
        self._placed = Placed(field, np.eye(3), np.zeros(3), 1e-3 / MM, STIFFNESS)
        metres, material = 1e-3 * way.radius * largest, Material(way.friction, way.friction, 0, 0)
        self._contact = NativeContact(self._placed, metres, material=material)
        self._contact.set(budget=way.budget)
        path = way.path(way.radius * largest) * 1e-3
        self.probe, self._pose, self._last = 1e3 * MM * path[-1], np.eye(4), None
        poses = way.turns(len(path)) if way.moving else (np.eye(4),)
        for pose, part in zip(poses, path[:, None] if way.moving else (path,), strict=True):
            self._go(part, pose)
        self._driven = len(self.proxies)
        left = np.linalg.norm(self.proxies[-1][-1] - self.probe) / MM * 1e-3
        self.rest(DUE + 1.2 * left / self._contact.options.slide)

    def patience(self, looks):
        """Return how many seconds more it may rest before it is late; 0 or less: it is late.

        Time in which it goes as fast as it has to does not count, so that a way around an edge,
        which is longer than the distance, may take longer.

        Parameters
        ----------
        looks : bool
            Whether a small number of looks per second excuses it.
        """
        speed, due, rate = self._contact.options.slide, DUE, self.way.budget / self.way.dt
        if looks:
            speed, due = min(speed, STRIDE * rate), max(due, LOOKS / rate)
        path = np.concatenate([self.proxies[self._driven - 1][-1:], *self.proxies[self._driven :]])
        gone = np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / MM * 1e-3
        rested = (len(path) - 1) * self.way.dt
        return due - (rested - gone / speed) if rested < LATER else 0

    def rest(self, seconds):
        """Stay where the probe is."""
        ticks = int(seconds / self.way.dt) + 1
        self._go(np.repeat(self.probe[None] * 1e-3 / MM, ticks, 0), self._pose)

    def _go(self, path, pose):
        turn, at = pose[:3, :3], pose[:3, 3]
        if (pose != self._pose).any():
            self._contact.move(self._placed._replace(rotation=turn, translation=at))
        steps = self._contact.follow(path @ turn.T + at, self.way.dt)
        force, self._pose = steps.force @ turn, pose
        self.proxies.append((steps.proxy - at) @ turn * 1e3 * MM)
        if self._last is not None:
            path, force = (np.concatenate(p) for p in zip(self._last, (path, force), strict=True))
        moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
        bound = STIFFNESS * (2 * moved + self._contact.options.slide * self.way.dt)
        changed = np.linalg.norm(np.diff(force, axis=0), axis=1)
        self.over += int((changed > bound * (1 + 1e-6) + 1e-9).sum())
        self._last = path[-1:], force[-1:]


def behind(own, followed):
    """Return how far (mm) proxies would come nearer to their probes, and whether they should."""
    proxy, probe = (np.array(c) for c in zip(*((f.proxies[-1][-1], f.probe) for f in followed),
                                             strict=True))  # fmt: skip
    radius, friction = np.array([(f.radius, f.way.friction) for f in followed]).T
    end, gain = walk(own, proxy, probe, radius, 0.02 * MM)
    off = np.linalg.norm(end - proxy, axis=1) / MM
    return off, (off > NEAR) & (gain > np.sin(np.arctan(friction) + SLANT))


def overdue(own, followed, looks):
    """Return those that are still behind when their `Followed.patience` has run out."""
    late = [followed[i] for i in np.flatnonzero(behind(own, followed)[1])]
    while waiting := [one for one in late if one.patience(looks) > 0]:
        for one in waiting:
            one.rest(one.patience(looks))
        late = [late[i] for i in np.flatnonzero(behind(own, late)[1])]
    return late


def is_free(own, one):
    """Return whether a probe could go straight from its proxy to where it is."""
    share = np.linspace(0, 1, ALONG)[:, None]
    proxy = one.proxies[-1][-1]
    height = own(proxy + share * (one.probe - proxy))[0] - one.radius
    return bool(height.min() >= min(0, height[0]) - GRAZED * MM)


def judge(field, kind, solid, ways, largest):
    """Return a `Counter` of what came of ways on one field, and how far (mm) the worst is left."""
    own = solid.distance if kind == "exact" else lambda points: field.query(points)[:2]
    seen, followed = Counter(ways=len(ways)), [Followed(field, way, largest) for way in ways]
    slow = overdue(own, followed, looks=False)
    seen["held"] = sum(is_free(own, one) for one in slow)
    late = overdue(own, slow, looks=True) if slow else []
    for one in late:
        one.rest(LATER)
    off, left = behind(own, late) if late else (np.zeros(0), np.zeros(0, bool))
    seen["slow"], seen["late"], seen["left"] = len(slow), len(late), int(left.sum())
    for one in followed:
        places = np.concatenate(one.proxies)
        deep = one.radius - own(places[:: 1 if one.way.dt > 1e-3 else 4])[0]
        seen["passes"] += int(deep.max() > max(0, deep[0]) + DEEP * MM)
        seen["bounds"] += one.over > 0
    return seen, off[left].max(initial=0)


def told(seen):
    """Return a line of what came of ways."""
    words = {"left": "left behind", "held": "held on a free way", "late": "late", "slow": "slow"}
    words["passes"] = "passes"
    words["bounds"] = "over a bound"
    return f"{seen['ways']} ways, " + ", ".join(f"{seen[k]} {word}" for k, word in words.items())

"""Whether a proxy always comes along, judged by a walk that shares no code with it.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/leaving.py [WAYS [SEED [NETWORKS]]]

A probe is pressed, slid and led away on objects of 100 mm: corners of 3 to 8 walls turned anyhow,
grooves, slits, needles, a torus, and, where PANDIS_MESHES is set, three scans; and, if NETWORKS is
a folder of `networks.py`, on its networks. Radius, friction, budget and the length of a tick are
drawn for each way; every eighth object moves. Then the probe rests as long as `slide` allows for
what is left, and 50 ms more. What counts against the contact is

    left     a walk in small steps from the proxy towards the probe, outside of the field's own
             surface, comes nearer than friction explains, even a second later
    passes   a proxy lay deeper than the field's largest error and 0.05 mm, by libigl's distance
    bounds   a force changed by more than the stiffness allows for the ways of a tick

`late` are those that needed more time: in sharp edges a budget does not reach far in a tick.
"""

import os
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import trimesh
from bodies import UNIT, field_of
from common import ROOT, SCANS, load

sys.path.insert(0, str(ROOT / "tests"))

from oracle import Solid, walk
from ways import SHAPES, draw

from pandis.geometry.body import Body
from pandis.geometry.frame import UNIT_SIDE, Frame
from pandis.native.contact import Material, NativeContact
from pandis.native.runtime import NativeField
from pandis.native.scene import Placed

#: Per kind of field: the share of all ways, and the largest radius (mm of 100).
KINDS = {
    "exact": (0.4, 5.0),
    "compact-16": (0.3, 5.0),
    "spline-800K": (0.1, 1.0),
    "tricubic-96": (0.1, 1.0),
    "trilinear-normal-96": (0.1, 1.0),
}
NETWORK, NETWORK_SHARE = "pandis-exact", 0.01
MM, STIFFNESS, MOVING = UNIT_SIDE / 100, 400.0, 8
#: How near the proxy has to come to where the walk leads (mm), and of what does not count as deep.
NEAR, DEEP = 0.05, 0.05
#: Seconds after which a proxy that is late is left behind.
LATER = 1.0


def meshes(rng, corners):
    """Yield (name, vertices, faces, places) in the unit frame."""
    for name, make in SHAPES.items():
        for _ in range(corners if name.startswith("corner") else 1):
            mesh, places = make(rng)
            turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
            vertices = mesh.vertices @ turn.T
            frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
            yield (
                name,
                frame.to_unit(vertices),
                np.asarray(mesh.faces, np.int64),
                (places, turn, frame),
            )
    for name in SCANS if os.environ.get("PANDIS_MESHES") else ():
        yield (name, *load(SCANS[name]), None)


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
        self._contact.settings.budget = way.budget
        path = way.path(way.radius * largest) * 1e-3
        self.probe, self._pose, self._last = 1e3 * MM * path[-1], np.eye(4), None
        poses = way.turns(len(path)) if way.moving else (np.eye(4),)
        for pose, part in zip(poses, path[:, None] if way.moving else (path,), strict=True):
            self._go(part, pose)
        left = np.linalg.norm(self.proxies[-1][-1] - self.probe) / MM * 1e-3
        self.rest(0.05 + 1.2 * left / self._contact.settings.slide)

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
        bound = STIFFNESS * (2 * moved + self._contact.settings.slide * self.way.dt)
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
    return off, (off > NEAR) & (gain > friction / np.sqrt(1 + friction**2) + 0.05)


def judge(field, kind, solid, ways, largest):
    """Return a `Counter` of what came of ways on one field, and how far (mm) the worst is left."""
    error = float(np.abs(field.query(solid.points(20_000)).distance).max())
    own = solid.distance if kind == "exact" else lambda points: field.query(points)[:2]
    seen, followed = Counter(ways=len(ways)), [Followed(field, way, largest) for way in ways]
    for one in followed:
        places = np.concatenate(one.proxies)
        deep = one.radius - solid.distance(places[:: 1 if one.way.dt > 1e-3 else 4])[0]
        seen["passes"] += int(deep.max() > error + DEEP * MM)
        seen["bounds"] += one.over > 0
    late = [followed[i] for i in np.flatnonzero(behind(own, followed)[1])]
    for one in late:
        one.rest(LATER)
    off, left = behind(own, late) if late else (np.zeros(0), np.zeros(0, bool))
    seen["left"], seen["late"] = int(left.sum()), int((~left).sum())
    if os.environ.get("SHOW"):
        print(*(f"   {off[i]:.3g} {late[i].way}" for i in np.flatnonzero(left)[:3]), sep="\n")
    return seen, off[left].max(initial=0)


def main(wanted=2000, seed=0, networks=None):
    """Follow all ways; print a row for each shape and field; return whether anything was wrong."""
    rng, wrong = np.random.default_rng(seed), Counter()
    listed = list(meshes(rng, max(1, wanted // 20_000)))
    for name, vertices, faces, where in listed:
        body, solid = Body(vertices, faces.astype(np.int32), UNIT), Solid(vertices, faces)
        trained = Path(networks or ".") / f"{name}.pandis"
        kinds = KINDS | ({NETWORK: (NETWORK_SHARE, 5.0)} if networks and trained.exists() else {})
        for kind, (share, largest) in kinds.items():
            field = NativeField(trained) if kind == NETWORK else field_of(body, kind)
            ways = draw(solid, where, max(1, round(wanted * share / len(listed))), rng, MM)
            seen, worst = judge(field, kind, solid, ways, largest)
            wrong += seen
            print(f"{name}, {kind}: {told(seen)}, {worst:.2g} mm at most", flush=True)
    print(f"in all: {told(wrong)}")
    return bool(wrong["left"] or wrong["passes"] or wrong["bounds"])


def told(seen):
    """Return a line of what came of ways."""
    words = {"left": "left behind", "late": "late", "passes": "passes", "bounds": "over a bound"}
    return f"{seen['ways']} ways, " + ", ".join(f"{seen[k]} {word}" for k, word in words.items())


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(main(*map(int, given[:2]), *given[2:3]))

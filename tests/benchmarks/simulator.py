"""Our fields against MuJoCo's own octree in MuJoCo; writes docs/figures/simulator.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/simulator.py [STARTS [FEW [SCENE...]]]

Three scenes, a metre or so in size, as MuJoCo's own examples are: a ball that is thrown at the
bunny, a peg in a hole of a block, a nut on a bolt. The same mesh draws, weighs and bounds an object
whatever its field is. `error`: of penalty forces from MuJoCo's own distances and gradients, as in
the paper (0 to 0.01 below the surface of the unit frame), and where a device presses (10 cm,
400 N/m). `step_us`: median of a step in contact; all fields take turns in one process, the same
states for each. Then STARTS random starts of 300 steps each (1,000 by default; FEW, 100 by default,
for depths 7 and 8 and for the exact mesh), judged by the exact distance of points of what moves:
`overlap`: how deep the deepest lies where anything overlaps, mm; `tunnelled`: starts in which one
lies too deep, as many do without contacts; `rise`: how far the energy rises above its lowest
before, in weight times a metre; `over_start`: starts whose energy exceeds that of their start.
Fields are kept in the folder PANDIS_FIELDS, if it is set.
"""

import os
import sys
import tempfile
import time
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh
from bodies import UNIT, file_of
from common import ROOT, SCANS, load, write

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.base.physical import Scale
from pandis.bridges import mujoco as plugin
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.measure import contact_errors, draw_contacts
from pandis.pipeline.geometry.sampling import blue_noise, probes

sys.path.insert(0, str(ROOT / "tests/helpers"))

from pandis.bridges.mujoco.asking import asker

STEPS, EVERY, POINTS, TIMED, CONTROL = 300, 10, 400, 400, 20
NATIVE = {f"native-{depth}": depth for depth in (6, 7, 8)}
OURS = "tricubic-64", "spline-800K", "spline-3200K", "compact-16", "exact"
FEWER = "native-7", "native-8", "exact"
SHARED = {}
COLUMNS = (
    *("scene", "field", "shallow", "contact_mn", "step_us", "step_p99_us", "steps_in_contact"),
    *("starts", "tunnelled", "overlap", "overlap_p99", "rise", "rise_p99", "over_start"),
)


class Part(NamedTuple):
    """One of a scene's objects: its body in the unit frame, and the metres of a length there."""

    body: Body
    metre: float

    @classmethod
    def of(cls, vertices, faces):
        """Of a mesh in metres whose bounding box has its centre at 0."""
        metre = float(np.ptp(vertices, axis=0).max()) / UNIT_SIDE
        return cls(Body(vertices / metre, faces, UNIT), metre)

    def distance(self, points):
        """Exact distance (n,) of points (n, 3), both in metres."""
        asked = self.body.distance.distance_and_normal(points / self.metre, check=False)
        return asked[0] * self.metre


# ---------------------------------------------------------------- meshes


def threaded(radius, depth, pitch, height, around=96):
    """Return a grid (levels, around, 3) of a threaded surface around z."""
    levels = int(height / pitch * 24) + 1
    z = np.linspace(-height / 2, height / 2, levels)[:, None]
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]
    radius = radius - depth * (0.5 - 0.5 * np.cos(2 * np.pi * z / pitch - angle))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle),
                     np.broadcast_to(z, radius.shape)], axis=-1)  # fmt: skip


def strip(low, high):
    """Return faces between two rings of vertex numbers, seen from where they turn to the left."""
    after = np.roll(low, -1), np.roll(high, -1)
    return np.concatenate([np.stack([low, after[0], after[1]], axis=1),
                           np.stack([low, after[1], high], axis=1)])  # fmt: skip


def rings_of(grid, first=0):
    """Return the vertex numbers (levels, around) of a grid, and the faces between its rings."""
    rings = first + np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
    return rings, np.concatenate([strip(a, b) for a, b in pairwise(rings)])


def bolt(*size):
    """Return vertices and faces of a threaded rod."""
    grid = threaded(*size)
    rings, sides = rings_of(grid)
    ends = np.array([[0, 0, grid[0, 0, 2]], [0, 0, grid[-1, 0, 2]]])
    low, high, count = rings[0], rings[-1], rings.size
    caps = [np.stack([np.roll(low, -1), low, np.full_like(low, count)], axis=1),
            np.stack([high, np.roll(high, -1), np.full_like(low, count + 1)], axis=1)]  # fmt: skip
    return np.concatenate([grid.reshape(-1, 3), ends]), np.concatenate([sides, *caps])


def ring(inner, outer):
    """Return vertices and faces of what lies between two grids (levels, around, 3)."""
    inside, faces = rings_of(inner)
    outside, more = rings_of(outer, inside.size)
    ends = strip(inside[-1], outside[-1])[:, ::-1], strip(inside[0], outside[0])
    vertices = np.concatenate([inner.reshape(-1, 3), outer.reshape(-1, 3)])
    return vertices, np.concatenate([faces[:, ::-1], more, *ends])


def prism(sides, across, height, around=96, levels=40):
    """Return a grid (levels, around, 3) of the sides of a prism around z."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    off = (angle + np.pi / sides) % (2 * np.pi / sides) - np.pi / sides
    flat = (across / np.cos(off))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    z = np.linspace(-height / 2, height / 2, levels)
    return np.stack([np.column_stack([flat, np.full(around, at)]) for at in z])


# ---------------------------------------------------------------- scenes


class Scene(NamedTuple):
    """What stands still and what moves, where it starts, and how deep is through."""

    fixed: Part
    moving: Part | None  # None: the ball
    start: object
    thinnest: float
    options: str
    points: np.ndarray  # of what moves, in the frame of its body


BALL = 0.1


def thrown(part, rng):
    """Return a position and a velocity of a ball that flies at an object."""
    while True:
        foot, outward = (a[0] for a in part.body.surface.draw(1, rng)[:2])
        at = foot * part.metre + outward * (BALL + rng.uniform(0.02, 0.2))
        if part.distance(at[None])[0] > BALL + 0.01:
            velocity = rng.normal(size=3) * 0.3 - outward * rng.uniform(0, 1.5)
            return np.r_[at, 1, 0, 0, 0], np.r_[velocity, 0, 0, 0]


def placed(at, apart, tilt, spin):
    """Return what puts a body about there, tilted a little, with a small velocity."""

    def start(part, rng):
        turn = np.r_[1, rng.normal(size=3) * tilt]
        velocity = np.r_[rng.normal(size=3) * 0.1, rng.normal(size=2) * 0.1, rng.normal() * spin]
        return np.r_[at + rng.normal(size=3) * apart, turn / np.linalg.norm(turn)], velocity

    return start


def scenes():
    """Return all scenes by name."""
    own = 'sdf_iterations="{}" sdf_initpoints="{}"'
    vertices, faces = load(SCANS["bunny"])
    bunny = Part.of(vertices / UNIT_SIDE, faces)
    rod = Part.of(*bolt(0.26, 0.04, 0.12, 1.2))
    nut = Part.of(*ring(threaded(0.27, 0.04, 0.12, 0.36), prism(6, 0.42, 0.36)))
    block = Part.of(*ring(prism(96, 0.15, 0.5), prism(4, 0.5, 0.5)))
    peg = Part.of(*_closed(prism(96, 0.14, 0.8)))

    def spread(part):
        return blue_noise(part.body.surface, POINTS, np.random.default_rng(0))[0] * part.metre

    return {
        "ball": Scene(bunny, None, thrown, BALL, own.format(10, 40), np.zeros((1, 3))),
        "peg": Scene(block, peg, placed([0, 0, 0.45], 0.004, 0.01, 0.5), 0.03, own.format(15, 60),
                     spread(peg)),
        "bolt": Scene(rod, nut, placed([0, 0, 0.0], 0.001, 0.002, 2.0), 0.04, own.format(15, 60),
                      spread(nut)),
    }  # fmt: skip


def _closed(grid):
    """Return vertices and faces of a grid's surface with flat ends."""
    rings, sides = rings_of(grid)
    ends = grid[[0, -1]].mean(axis=1)
    full = np.full_like(rings[0], rings.size)
    caps = [np.stack([np.roll(rings[0], -1), rings[0], full], axis=1),
            np.stack([rings[-1], np.roll(rings[-1], -1), full + 1], axis=1)]  # fmt: skip
    return np.concatenate([grid.reshape(-1, 3), ends]), np.concatenate([sides, *caps])


def model_of(scene, field, folder):
    """Return MuJoCo's model of a scene whose objects have that kind of field."""
    assets, geoms, instances = "", [], ""
    for name, part in (("fixed", scene.fixed), ("moving", scene.moving)):
        if part is None:
            geoms.append(f'<geom size="{BALL}"/>')
            continue
        path = folder / f"{name}.obj"
        shown = part.body.vertices * part.metre
        trimesh.Trimesh(shown, part.body.faces, process=False).export(path)
        assets += f'<mesh name="{name}" file="{path}"/>'
        own = ""
        if field not in NATIVE:
            file = folder / f"{name}-{field}.pandis"
            if not file.exists():
                file.write_bytes(file_of(part.body, field))
            own = f'<plugin instance="{name}"/>'
            instances += f"""<instance name="{name}"><config key="file" value="{file}"/>
                             <config key="scale" value="{part.metre!r}"/></instance>"""
        geoms.append(f'<geom type="sdf" mesh="{name}">{own}</geom>')
    spec = mujoco.MjSpec.from_string(f"""
        <mujoco><option {scene.options}><flag energy="enable"/></option>
          <extension>{f'<plugin plugin="pandis.sdf">{instances}</plugin>' if instances else ""}
          </extension>
          <asset>{assets}</asset>
          <default><geom solref="0.01 1" solimp=".95 .99 .0001" friction="0.01"/></default>
          <worldbody>{geoms[0]}<body><freejoint/>{geoms[1]}</body></worldbody>
        </mujoco>""")
    for mesh in spec.meshes:
        mesh.octree_maxdepth = NATIVE.get(field, mesh.octree_maxdepth)
    return spec.compile()


# ---------------------------------------------------------------- what MuJoCo has of a field


def force_of(model, part):
    """Return what gives penalty forces (n, 3), unit frame, k = 1, of the first geom's field."""
    ask, turn = asker(model), np.empty(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[0])
    turn = turn.reshape(3, 3)

    def force(points):
        distance, gradient = ask((points * part.metre - model.mesh_pos[0]) @ turn)
        length = np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)
        return np.maximum(-distance, 0)[:, None] / part.metre * (gradient / length) @ turn.T

    return force


def errors(model, part):
    """Return the columns of a field's force errors."""
    points, distance, normal = probes(part.body, 20_000, seed=1)["shallow"]
    force = force_of(model, part)
    wanted = np.maximum(-distance, 0)[:, None] * normal
    rng, scale = np.random.default_rng(1), Scale(0.1, 400.0)
    contacts = contact_errors(force, draw_contacts(part.body, scale, 20_000, rng=rng))
    return {"shallow": 1e3 * float(np.linalg.norm(force(points) - wanted, axis=1).mean()),
            "contact_mn": 1e3 * next(iter(contacts.values()))["newtons"]}  # fmt: skip


# ---------------------------------------------------------------- steps


def started(model, scene, seed):
    """Return data at a random start."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = scene.start(scene.fixed, np.random.default_rng(seed))
    return data


def states(model, scene, count):
    """Return states (count) in contact, of random starts on one model."""
    found, seed = [], 0
    while len(found) < count and seed < 40 * count:
        data, seed = started(model, scene, 10_000 + seed), seed + 1
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            if data.ncon:
                found.append((data.qpos.copy(), data.qvel.copy()))
                if seed % 2:
                    break
    return found[:count]


def timed(models, scene):
    """Return the columns of the times of steps, by field: in turns, from the same states."""
    first = models["native-6"]
    asked, took = states(first, scene, TIMED), {name: [] for name in models}
    datas = {name: mujoco.MjData(model) for name, model in models.items()}
    for qpos, qvel in asked:
        for name, model in models.items():
            data = datas[name]
            data.qpos[:], data.qvel[:] = qpos, qvel
            start = time.perf_counter()
            mujoco.mj_step(model, data)
            took[name].append(1e6 * (time.perf_counter() - start))
    return {name: {"step_us": float(np.median(us)), "step_p99_us": float(np.percentile(us, 99))}
            for name, us in took.items()}  # fmt: skip


def followed(model, scene, seed):
    """Return how deep one start's overlaps are (metres), whether it tunnelled, and its energies."""
    data = started(model, scene, seed)
    places, energy, touched = [], [], 0
    for step in range(STEPS):
        mujoco.mj_step(model, data)
        energy.append(data.energy.sum())
        touched += data.ncon > 0
        if step % EVERY == EVERY - 1:
            turn = data.xmat[1].reshape(3, 3)
            places.append(scene.points @ turn.T + data.xpos[1])
    energy = np.array(energy)
    weight = model.body_mass[1] * 9.81
    distance = scene.fixed.distance(np.concatenate(places)).reshape(len(places), -1)
    radius = BALL if scene.moving is None else 0.0
    deep = radius - distance.min(axis=1)
    rise = (energy - np.minimum.accumulate(energy)).max() / weight
    over = (energy.max() - energy[0]) / weight
    return deep[deep > 0], deep.max() > scene.thinnest, rise, over, touched


def _follow(seed):
    return SHARED["follow"](seed)


def simulated(model, scene, starts):
    """Return the columns of random starts."""
    SHARED["follow"] = partial(followed, model, scene)  # reaches processes by their fork
    with get_context("fork").Pool() as pool:
        runs = pool.map(_follow, range(starts), chunksize=1)
    deep = 1e3 * np.concatenate([run[0] for run in runs])
    _, through, rise, over, touched = (np.array(column) for column in zip(*(
        (0, *run[1:]) for run in runs), strict=True))  # fmt: skip
    return {
        "starts": starts, "tunnelled": int(through.sum()),
        "steps_in_contact": float(touched.mean() / STEPS),
        "overlap": float(np.median(deep)), "overlap_p99": float(np.percentile(deep, 99)),
        "rise": float(np.median(rise)), "rise_p99": float(np.percentile(rise, 99)),
        "over_start": float((over > 1e-3).mean()),
    }  # fmt: skip


def demand_control(name, scene, model):
    """Demand that whatever has no contacts tunnels: else that column would say nothing."""
    model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    through = simulated(model, scene, CONTROL)["tunnelled"]
    model.opt.disableflags = 0
    if through < CONTROL / 4:  # some starts go by
        raise PandisError(f"{name}: without contacts {through} of {CONTROL} starts tunnel")
    print(f"{name}: without contacts {through} of {CONTROL} tunnel", file=sys.stderr, flush=True)


def main(starts=1000, few=100, *names):
    """Measure the scenes of these names, or all: first all times, while nothing else runs."""
    plugin.register()
    made, rows = {}, []
    for name, scene in scenes().items():
        if names and name not in names:
            continue
        folder = Path(os.environ.get("PANDIS_FIELDS") or tempfile.mkdtemp()) / name
        folder.mkdir(parents=True, exist_ok=True)
        models = {field: model_of(scene, field, folder) for field in (*NATIVE, *OURS)}
        demand_control(name, scene, models["native-6"])
        took = timed(models, scene)
        made[name] = scene, models, {field: errors(model, scene.fixed) | took[field]
                                     for field, model in models.items()}  # fmt: skip
        print(name, made[name][2], file=sys.stderr, flush=True)
    for name, (scene, models, measured) in made.items():
        for field, model in models.items():
            many = min(few, starts) if field in FEWER else starts
            row = {"scene": name, "field": field} | measured[field]
            rows.append(row | simulated(model, scene, many))
            print(rows[-1], file=sys.stderr, flush=True)
    if not names:
        write("simulator", COLUMNS, rows)


if __name__ == "__main__":
    main(*(int(text) for text in sys.argv[1:3]), *sys.argv[3:])

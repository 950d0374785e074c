"""Scenes of many objects against one; write docs/figures/scenes.csv.

Usage: .venv/bin/python tests/benchmarks/scenes.py

Copies of the bunny that ships with PyMeshLab, as `spline-auto` of 800 KB and as its exact mesh,
2 to 5 cm long and turned anyhow, lie in a cube of 30 cm; the probe goes through it at 0.5 m/s and
turns at random. Single queries are timed; medians of three turns. `one in contact` is the median
over the ticks of a single bunny with the probe inside of it. Every scene is compared with asking
every object, for two million questions.
"""

import sys

import numpy as np
from common import write
from scipy.spatial.transform import Rotation

from native import bunny, fields
from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

#: Half the side of the cube (m), way of a tick (m), ticks.
HALF, PACE, TICKS, TURNS = 0.15, 5e-4, 20_000, 3
COUNTS = (1, 10, 50, 200, 1000)
COLUMNS = ("field", "scene", "objects", "median_us", "p999_us", "asked", "of_one", "same")


def walk(count, rng, half):
    """Return the path (count, 3) of a probe at a constant speed, reflected at the cube's faces."""
    turning = rng.normal(size=(count, 3)) * 0.05
    along = np.cumsum(turning, axis=0) + rng.normal(size=3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    path = np.cumsum(along * PACE, axis=0) / half
    return half * (1 - np.abs((path + 1) % 4 - 2))


def place(field, rng, half=HALF):
    """Return a field somewhere in the cube, turned anyhow."""
    scale = rng.uniform(0.02, 0.05) * field.frame.scale / UNIT_SIDE
    rotation = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()
    return Placed(field, rotation, rng.uniform(-half, half, 3), scale, 400.0)


def native_fields():
    """Yield name and opened file of the fields, with their clearance."""
    vertices, faces = bunny()
    engine = None
    for name, _, field in fields(vertices, faces):
        engine = engine or field.engine
        if name in ("exact", "spline-auto"):
            safe = clearance(lambda p, f=field: f.query(p)[::2], engine)
            print(f"{name}: margins {safe[6]:.2g}, {safe[7]:.2g}", file=sys.stderr)
            yield name, NativeField(native_bytes(field, {}, safe=safe))


def in_contact(field):
    """Return the seconds of ticks within a single object."""
    scene = NativeScene([Placed(field, np.eye(3), np.zeros(3), 0.05, 400.0)])
    answer = scene.answer(walk(TICKS, np.random.default_rng(1), 0.02), timed=True)
    return answer.seconds[answer.force.any(axis=1)]


def main():
    """Measure, and write the table."""
    rows = []
    for name, field in native_fields():
        scenes = {
            count: NativeScene([place(field, np.random.default_rng([2, k])) for k in range(count)])
            for count in COUNTS
        }
        path = walk(TICKS, np.random.default_rng(3), HALF)
        seconds = {count: [] for count in (0, *COUNTS)}
        for turn in range(TURNS):
            print(f"{name}: turn {turn + 1}", file=sys.stderr, flush=True)
            seconds[0].append(in_contact(field))
            for count, scene in scenes.items():
                answer = scene.answer(path, timed=True)
                seconds[count].append(answer.seconds)
        one = np.median(np.concatenate(seconds[0]))
        for count, turns in seconds.items():
            found = np.concatenate(turns)
            row = {"field": name, "scene": "one in contact", "objects": 1, "asked": 1, "same": ""}
            if count:
                long = walk(2_000_000 // count, np.random.default_rng(4), HALF)
                answer = scenes[count].answer(long)
                same = np.array_equal(answer.force, scenes[count].ask_all(long))
                row = {"field": name, "scene": "cube", "objects": count, "same": same}
                row["asked"] = float(answer.queries.mean())
            row |= {
                "median_us": float(np.median(found)) * 1e6,
                "p999_us": float(np.percentile(found, 99.9)) * 1e6,
                "of_one": float(np.median(found) / one),
            }
            rows.append(row)
    write("scenes", COLUMNS, rows)


if __name__ == "__main__":
    main()

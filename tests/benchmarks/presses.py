"""Lets a hand press through thin places, with a proxy and without; writes docs/figures/presses.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/presses.py [PRESSES [NETWORKS]]

A plate of 2 mm, the bunny's ears, a sword and a slit of 0.5 mm, each 10 cm long, under every
simulated device at its stiffness (1000 N/m at most). The hand presses with 1.2 times the device's
largest force, up to 17 degrees off the normal. Fields that miss more of the force on a shape than
is allowed (`missing`) are listed with that share, and not pressed. Some presses begin where the
field has the object and the shape has none (`ghosts`). What counts as a pass, and who says so:
`pandis.pipeline.judge.servo.passes`. PRESSES are all presses together (10,000 by default); a
twentieth of them is on networks, if NETWORKS, a folder of `networks.py`, holds some.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from bodies import UNIT, field_of
from common import SCANS, load, write

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE, Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.passes import ABOVE, Oracle, draw, free_starts, judge, run
from pandis.pipeline.judge.servo.walls import compare, open_walls
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.runtime.contact import Feel
from pandis.runtime.field import NativeField

SIZE, STIFFEST, SLANT, SURFACE = 0.1, 1000.0, 0.3, 100_000
SWORD = "watertight/sword_22293v_44582f.obj"
NETWORK = "pandis-exact"
KINDS = "exact", "compact-16", "spline-800K", "tricubic-96"
COLUMNS = (
    *("shape", "field", "missing", "error_mm", "device", "stiffness_n_m", "ghosts", "presses"),
    "strongest_n",
    *("deepest_mm", "passes", "around", "ended", "penalty_strongest_n", "penalty_passes"),
)


def block(size, at=(0, 0, 0)):
    """Return a subdivided box, m."""
    box = trimesh.creation.box(size)
    for _ in range(3):
        box = box.subdivide()
    return box.vertices + np.array(at), box.faces


def shapes():
    """Return meshes, unit frame, which of their faces are pressed (m), and from how far above."""
    slit = [block((0.1, 0.05, 0.02), (0, 0, z)) for z in (-0.01025, 0.01025)]
    both = (np.concatenate([v for v, _ in slit]),
            np.concatenate([slit[0][1], slit[1][1] + len(slit[0][0])]))  # fmt: skip
    made = {"plate": block((0.1, 0.1, 0.002)), "slit": both}
    for name, (vertices, faces) in made.items():
        frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
        made[name] = frame.to_unit(vertices), faces
    where = {
        "plate": lambda c: (np.abs(c[:, :2]).max(axis=1) < 0.035) & (np.abs(c[:, 2]) > 9e-4),
        "slit": lambda c: (np.abs(c) < [0.04, 0.02, 3e-4]).all(axis=1),
        "bunny": lambda c: c[:, 1] > 0.022,
        "sword": lambda c: np.ones(len(c), bool),
    }
    made |= {"bunny": load(SCANS["bunny"]), "sword": load(SWORD)}
    return {name: (*mesh, where[name], 2e-4 if name == "slit" else ABOVE)
            for name, mesh in made.items()}  # fmt: skip


def places_on(vertices, faces, which, count, rng):
    """Return points (n, 3) of some faces, by area, and their normals."""
    across = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]],
                      vertices[faces[:, 2]] - vertices[faces[:, 0]])  # fmt: skip
    area = np.linalg.norm(across, axis=1)
    chance = area * which(vertices[faces].mean(axis=1))
    picked = rng.choice(len(faces), count, p=chance / chance.sum())
    share = rng.dirichlet(np.ones(3), count)
    feet = np.einsum("ij,ijk->ik", share, vertices[faces[picked]])
    return feet, across[picked] / area[picked][:, None]


def pressed(field, spec, oracle, presses, error):
    """Return the columns of one field on one device."""
    stiffness = min(spec.stiffness, STIFFEST)
    proxy = list(run(field, spec, SIZE, stiffness=stiffness, presses=presses, feel=Feel()))
    penalty = list(run(field, spec, SIZE, stiffness=stiffness, presses=presses))
    judged, other = judge(proxy, oracle, error), judge(penalty, oracle, error, detours=False)
    return {
        "stiffness_n_m": stiffness, "presses": judged.presses, "passes": judged.passed,
        "strongest_n": max(s.strongest for s, _ in proxy), "deepest_mm": 1e3 * judged.deepest,
        "around": judged.around, "ended": judged.ended, "penalty_passes": other.passed,
        "penalty_strongest_n": max(s.strongest for s, _ in penalty),
    }  # fmt: skip


def main(wanted, networks=None):
    """Press all shapes, wanted presses in all."""
    rows, metres = [], SIZE / UNIT_SIDE
    count = dict.fromkeys(KINDS, -(-wanted // 48)) | {NETWORK: -(-wanted // 320)}
    for shape, (vertices, faces, which, above) in shapes().items():
        body, oracle = Body(vertices, faces, UNIT), Oracle(vertices * metres, faces)
        exact = ExactField("exact", body)
        walls = open_walls(exact, Scale(SIZE, 400.0), 0)
        trained = Path(networks or ".") / f"{shape}.pandis"
        for kind in (*KINDS, NETWORK) if trained.exists() else KINDS:
            rng = np.random.default_rng(0)
            field = NativeField(trained) if kind == NETWORK else field_of(body, kind)
            missing = compare(ExportedField(kind, field), walls).missing
            on_it = places_on(vertices, faces, lambda c: np.ones(len(c), bool), SURFACE, rng)[0]
            error = float(np.abs(field.query(on_it).distance).max()) * metres
            row = {"shape": shape, "field": kind, "missing": missing, "error_mm": 1e3 * error}
            if missing > MISSING_LIMIT:
                rows.append(row)
                continue
            for device, spec in DEVICES.items():
                places = places_on(vertices * metres, faces, which, count[kind], rng)
                stiffness = min(spec.stiffness, STIFFEST)
                presses = draw(places, spec, stiffness, slant=SLANT, rng=rng, above=above)
                presses = free_starts(presses, oracle, above)
                starts = np.array([press.start for press in presses]) / metres
                row["ghosts"] = int((field.query(starts).distance <= 0).sum())
                rows.append(row | {"device": device} | pressed(field, spec, oracle, presses, error))
                print(rows[-1], flush=True)
    if not rows:
        raise PandisError("no field could be pressed")
    write("presses", COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000, *sys.argv[2:3])

"""Networks trained to the end against the grids of the paper; renew docs/figures/full.csv.

Usage: .venv/bin/python tests/benchmarks/full.py MESHES WEIGHTS.npz…

MESHES is a folder that `training.py prepare` has made, the WEIGHTS are what `training.py` leaves
beside its table, named by mesh and recipe. Rows of networks that are not given stay as they are, so
that what was trained in several sittings comes together. Errors are means of ‖F - F_exact‖ at k = 1
in the unit frame: over 50,000 points 0 to 0.01 (shallow) and 0 to 0.04 (deep) below the surface,
over a contact set of 50,000 (contact) with the share of the surface that is missing, and over eight
trajectories of the default configuration (path).
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from common import ROOT, SCANS, write
from fields import dense, spline
from training import Scan, log

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.physical import Scale
from pandis.pipeline.geometry.measure import contact_errors, draw_contacts
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.training.network import usual_omega
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.ask.targets import DeviceOptions
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress

#: The last is the scan of 871,414 faces, as large as the paper's: `training.py prepare MESHES
#: dragon-full=stanford/dragon_vrip_437645v_871414f.ply.gz`.
MESHES = (*SCANS, "dragon-full")
SEEDS = range(2, 10)
POINTS = 50_000
GRIDS = (
    *(f"{kind}{box}-{size}" for size in (32, 64) for kind in ("nearest", "trilinear")
      for box in ("", "-box")),
    "tricubic-58",
    "spline-auto",
)  # fmt: skip
UNIT_AT = UNIT.attributes()
#: What a row is of; the rest are its figures.
KEYS = ("mesh", "field", "weighting", "points", "seed", "steps")
FIGURES = ("shallow", "deep", "contact", "missing", "path")


class Measure:
    """The points that fields of one mesh are measured on."""

    def __init__(self, path):
        self.scan = scan = Scan(path)
        self.engine = scan.strata.engine
        scale = Scale.of(DeviceOptions())
        self.contacts = draw_contacts(
            scan.body, scale, POINTS, rng=np.random.default_rng(4), even=True
        )
        self.paths = []
        for seed in SEEDS:
            path, _ = trace(scan.body, TrajectoryOptions(), seed, progress=silent_progress)
            self.paths.append(tuple(path[key] for key in ("points", "distance", "normal")))

    def figures(self, field):
        """Return the figures of a field."""

        def force(points):
            return penalty_force(*field.answer(points))

        def error(points, distance, normal):
            off = force(points) - penalty_force(distance, normal)
            return float(np.linalg.norm(off, axis=1).mean())

        found = {name: error(*self.scan.sets[name]) for name in ("shallow", "deep")}
        contact = contact_errors(force, self.contacts)["contact-deep"]
        found |= {"contact": contact["mean"], "missing": contact["missing"]}
        return found | {"path": float(np.mean([error(*path) for path in self.paths]))}


def grid(name, engine):
    """Return a grid field of the mesh."""
    kind, _, size = name.rpartition("-")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.zarr.zip"
        mesh = engine.vertices, engine.faces
        made = (
            spline(*mesh, 800_000, path) if size == "auto" else dense(*mesh, kind, int(size), path)
        )
    held = Artifact("grid", made[0], made[1] | UNIT_AT)
    return open_field(known_field(name), held)


def network(path):
    """Return a trained network as a field, and its options."""
    found = np.load(path)
    options = eval(str(found["options"]), {"__builtins__": {}})  # written by training.py
    arrays = {key: found[key] for key in found.files if key != "options"}
    shape = {key: options[key] for key in ("width", "depth", "omega")}
    shape["omega"] = shape["omega"] or usual_omega(shape["width"])
    shape["outputs"] = 1 if options["direction"] == "gradient" else 4
    artifact = Artifact("model", arrays, {"architecture": shape} | UNIT_AT)
    return SirenField(options["recipe"], artifact), options


def by_mesh(weights):
    """Return the paths of weights by the mesh that they are named after."""
    found = {}
    for path in sorted(map(Path, weights)):
        found.setdefault(path.name.partition("-pandis")[0], []).append(path)
    return found


def renew(name, columns, keys, rows, order):
    """Write docs/figures/{name}.csv with rows, and those that were there of something else.

    The notes name the commit and the machine of each sitting.
    ``order`` says of a row where it belongs.
    """
    path = ROOT / "docs" / "figures" / f"{name}.csv"
    known, earlier = {}, []
    if path.exists():
        lines = path.read_text("utf-8").splitlines()
        notes = [line.removeprefix("# ") for line in lines if line.startswith("#")]
        at = dict(note.split(": ", 1) for note in notes)
        earlier = [note for note in notes if note.startswith("rows of ")]
        earlier.append(f"rows of {at['commit']}: {at['machine']}")
        for row in csv.DictReader(lines[len(notes) :]):
            known[tuple(row[key] for key in keys)] = row
    for row in rows:
        known[tuple(str(row[key]) for key in keys)] = row
    write(name, columns, sorted(known.values(), key=order), earlier)


def _order(row):
    """Return where a row belongs: by mesh, grids first, then as networks were trained."""
    fields = [*GRIDS, "pandis", "pandis-exact"]
    place = MESHES.index(row["mesh"]), fields.index(row["field"])
    return *place, row["points"], row["weighting"] == "batch", str(row["seed"])


def main(folder, *weights):
    """Measure, and write the table."""
    rows = []
    for mesh, paths in by_mesh(weights).items():
        measure = Measure(Path(folder) / f"{mesh}.npz")
        measured = [(grid(name, measure.engine), {}) for name in GRIDS]
        measured += [network(path) for path in paths]
        for field, options in measured:
            row = {"mesh": mesh, "field": field.name, "bytes": field.bytes}
            row |= {key: options.get(key, "") for key in KEYS[2:]} | measure.figures(field)
            rows.append(row)
            log(row)
    renew("full", (*KEYS, "bytes", *FIGURES), KEYS, rows, _order)


if __name__ == "__main__":
    main(*sys.argv[1:])

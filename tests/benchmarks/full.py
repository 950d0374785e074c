"""Networks trained to the end against the grids of the paper; write docs/figures/full.csv.

Usage: .venv/bin/python tests/benchmarks/full.py MESHES WEIGHTS.npz…

MESHES is a folder that `training.py prepare` has made, the WEIGHTS are what `training.py` leaves
beside its table, named by mesh and recipe. Errors are means of ‖F - F_exact‖ at k = 1 in the unit
frame: 50,000 points 0 to 0.01 (shallow) and 0 to 0.04 (deep) below the surface, and eight
trajectories of the default configuration, with the half-width of a 95 % interval over them.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from common import write
from fields import dense, spline
from training import Scan, log

from pandis.artifact import Artifact
from pandis.config import TrajectoryOptions
from pandis.evaluation.paths import interval
from pandis.fields.grids import GRID_OPENERS
from pandis.fields.siren import SirenField
from pandis.frame import Frame
from pandis.stage import silent_progress
from pandis.training.network import usual_omega
from pandis.trajectories import trace

SEEDS = range(2, 10)
GRIDS = ("nearest-32", "nearest-64", "trilinear-32", "trilinear-64", "tricubic-58", "spline-auto")
UNIT = {"frame": Frame((0.0, 0.0, 0.0), 1.0).attributes()}
COLUMNS = ("mesh", "field", "steps", "bytes", "shallow", "deep", "path", "path_interval")
COLUMNS += ("of_trilinear_64", "of_trilinear_64_interval")


def grid(name, engine):
    """Return a grid field of the mesh."""
    kind, _, size = name.rpartition("-")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.zarr.zip"
        mesh = engine.vertices, engine.faces
        made = (
            spline(*mesh, 800_000, path) if size == "auto" else dense(*mesh, kind, int(size), path)
        )
    return GRID_OPENERS[kind](name, Artifact(None, "grid", made[0], made[1] | UNIT, {}, ""))


def network(path):
    """Return a trained network as a field, and its steps."""
    found = np.load(path)
    options = eval(str(found["options"]), {"__builtins__": {}})  # written by training.py
    arrays = {key: found[key] for key in found.files if key != "options"}
    shape = {key: options[key] for key in ("width", "depth", "omega")}
    shape["omega"] = shape["omega"] or usual_omega(shape["width"])
    artifact = Artifact(None, "model", arrays, {"architecture": shape} | UNIT, {}, "")
    return SirenField(options["recipe"], artifact), options["steps"]


def main(folder, *weights):
    """Measure, and write the table."""
    rows = []
    for mesh in dict.fromkeys(Path(path).name.split("-")[0] for path in weights):
        scan = Scan(Path(folder) / f"{mesh}.npz")
        engine = scan.strata.engine
        for seed in SEEDS:
            options = TrajectoryOptions().model_dump() | {"seed": seed}
            path, _ = trace(scan.strata.surface, engine, options, silent_progress)
            scan.sets[seed] = tuple(path[key] for key in ("points", "distance", "normal"))
        fields = [(grid(name, engine), "") for name in GRIDS]
        own = [path for path in weights if Path(path).name.startswith(f"{mesh}-")]
        fields += sorted((network(path) for path in own), key=lambda one: (one[0].name, one[1]))
        found = [scan.errors(field) for field, _ in fields]
        paths = [np.array([errors[seed] for seed in SEEDS]) for errors in found]
        base = paths[GRIDS.index("trilinear-64")]
        for (field, steps), errors, path in zip(fields, found, paths, strict=True):
            row = {"mesh": mesh, "field": field.name, "steps": steps, "bytes": field.bytes}
            row |= {name: errors[name] for name in ("shallow", "deep")}
            row |= {"path": float(path.mean()), "path_interval": interval(path)}
            row["of_trilinear_64"] = float((path / base).mean())
            row["of_trilinear_64_interval"] = interval(path / base)
            rows.append(row)
            log(row)
    write("full", COLUMNS, rows)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Train networks and measure them; append to docs/figures/training.csv or another file.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/training.py prepare MESHES [N=FILE…]
       .venv/bin/python tests/benchmarks/training.py MESHES TABLE RUN…

MESHES is a folder for the repaired meshes (so that another machine needs no repair): the scans of
the accuracy bars, or the files of PANDIS_MESHES that are named. TABLE is a CSV file. A RUN is
mesh:recipe:key=value,key=value…, the keys those of the recipe: for instance
bunny:pandis-exact:steps=4500,threads=2 or dragon:pandis:steps=280000,device=cuda. A run that was
interrupted goes on from its checkpoint, beside the table, where its weights and its curve go.
Errors are means of ‖F - F_exact‖ at k = 1 in the unit frame: 50,000 points 0 to 0.01 (shallow)
and 0 to 0.04 (deep) below the surface, and the trajectory of the default configuration. Of
points uniform in the box: the largest force in free space (ghost), its share of such points
(ghosts), and the error below the band of training as a share of the force there (core).
"""

import csv
import hashlib
import sys
import time
from pathlib import Path

import numpy as np
import torch
import yaml
from common import SCANS, load, notes

from pandis.artifact import Artifact
from pandis.config import RECIPES, ExactRecipe, PaperRecipe, SampleOptions, TrajectoryOptions
from pandis.distance import MeshDistance
from pandis.fields.siren import SirenField
from pandis.forces import penalty_force
from pandis.frame import Frame
from pandis.sampling import Surface, probes
from pandis.stage import silent_progress
from pandis.strata import Strata
from pandis.training.trainer import Trainer
from pandis.trajectories import trace

COLUMNS = ("mesh", "recipe", "options", "device", "steps", "seconds", "points_per_s", "bytes")
COLUMNS += ("shallow", "deep", "trajectory", "ghost", "ghosts", "core", "restarts")


class Scan:
    """A mesh with its samples and probe sets."""

    def __init__(self, path):
        mesh = np.load(path)
        engine = MeshDistance(mesh["vertices"], mesh["faces"])
        surface = Surface(engine.vertices, engine.faces)
        law = SampleOptions().model_dump() | {"seed": 0}
        self.strata = Strata(surface, engine, law)
        arrays = self.strata.arrays(silent_progress)
        self.samples = Artifact(None, "samples", arrays, self.strata.attributes(), {}, "")
        self.sets = probes(surface, engine, 50_000, seed=1)
        box = np.random.default_rng(3).uniform(-1, 1, (50_000, 3))
        distance, normal = engine.distance_and_normal(box)
        core = distance < -law["depth"]
        self.free, self.core = box[distance > 0], (box[core], distance[core], normal[core])
        path, _ = trace(
            surface, engine, TrajectoryOptions().model_dump() | {"seed": 2}, silent_progress
        )
        self.sets["trajectory"] = tuple(path[key] for key in ("points", "distance", "normal"))

    def errors(self, field):
        """Return the mean force errors of a field on all sets."""
        found = {}
        for name, (points, distance, normal) in self.sets.items():
            off = penalty_force(*field.answer(points)) - penalty_force(distance, normal)
            found[name] = float(np.linalg.norm(off, axis=1).mean())
        ghost = np.linalg.norm(penalty_force(*field.answer(self.free)), axis=1)
        found |= {"ghost": float(ghost.max()), "ghosts": float((ghost > 0).mean())}
        points, distance, normal = self.core
        off = penalty_force(*field.answer(points)) - penalty_force(distance, normal)
        found["core"] = float(np.linalg.norm(off, axis=1).mean() / -distance.mean())
        return found


def train(scan, mesh, recipe, changes, folder):
    """Train one network; return a row of the table."""
    base = RECIPES.get(recipe, {"loss": "exact"})
    model = PaperRecipe if base["loss"] == "paper" else ExactRecipe
    own = {key: value for key, value in changes.items() if key != "seed"}
    options = model(**base | own).model_dump() | {"seed": changes.get("seed", 1), "recipe": recipe}
    key = hashlib.sha256(repr(options).encode()).hexdigest()[:12]
    checkpoint = folder / f"{mesh}-{recipe}.{key}.pt"
    trainer = Trainer(options, scan.samples, scan.strata, checkpoint, log)
    arrays, attributes = trainer.run(silent_progress)
    np.savez(checkpoint.with_suffix(".npz"), **arrays, options=repr(options))
    trainer.finish()
    attributes["frame"] = Frame((0.0, 0.0, 0.0), 1.0).attributes()
    field = SirenField(recipe, Artifact(None, "model", arrays, attributes, {}, ""))
    shown = options["batch"] * (2 if base["loss"] == "paper" else 1) * trainer.step
    return {
        "mesh": mesh,
        "recipe": recipe,
        "options": " ".join(f"{k}={v}" for k, v in changes.items()),
        "device": trainer.device,
        "steps": trainer.step,
        "seconds": trainer.elapsed,
        "points_per_s": shown / trainer.elapsed,
        "bytes": field.bytes,
        "restarts": attributes["restarts"],
        **scan.errors(field),
    }


def log(text):
    """Say something at once."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main(folder, table, *runs):
    """Do what the command line says."""
    scans, table = {}, Path(table)
    table.parent.mkdir(parents=True, exist_ok=True)
    new = not table.exists()
    for run in runs:
        mesh, recipe, *rest = run.split(":")
        pairs = [pair.split("=") for pair in rest[0].split(",")] if rest else []
        changes = {key: yaml.safe_load(value) for key, value in pairs}
        if mesh not in scans:
            scans[mesh] = Scan(Path(folder) / f"{mesh}.npz")
        row = train(scans[mesh], mesh, recipe, changes, table.parent)
        log(row)
        with table.open("a", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            if new:
                gpu = torch.cuda.get_device_name() if row["device"] == "cuda" else None
                stream.write(notes("training.py MESHES TABLE mesh:recipe:options…", gpu))
                writer.writeheader()
            new = False
            cells = {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()}
            writer.writerow(cells)


def prepare(folder, *named):
    """Repair the meshes once."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    meshes = dict(pair.split("=") for pair in named) or SCANS
    for name, path in meshes.items():
        vertices, faces = load(path)
        np.savez(Path(folder) / f"{name}.npz", vertices=vertices, faces=faces)


if __name__ == "__main__":
    if sys.argv[1] == "prepare":
        prepare(*sys.argv[2:])
    else:
        main(*sys.argv[1:])

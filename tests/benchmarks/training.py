"""Train networks and measure them; append to docs/figures/training.csv or another file.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/training.py prepare MESHES [N=FILE…]
       .venv/bin/python tests/benchmarks/training.py MESHES TABLE [together=N] [seconds=S] RUN…

MESHES is a folder for the repaired meshes (so that another machine needs no repair): the scans of
the accuracy bars, or the files of PANDIS_MESHES that are named. TABLE is a CSV file. A RUN is
mesh:recipe:key=value,key=value…, the keys those of the recipe: for instance
bunny:pandis-exact:steps=4500,threads=2 or dragon:pandis:steps=280000,device=cuda; besides them
seed=N, and law=paper: exact labels at the paper's points, on the surface and in the box, alone.
@NAME stands for the runs of a list of `runs.py`. A run that was interrupted goes on from its
checkpoint, beside the table, where its weights and its curve go; a finished one is not repeated.
With `together` so many runs share a GPU, and with `seconds` all end by then, the unfinished ones
at a checkpoint.
Errors are means of ‖F - F_exact‖ at k = 1 in the unit frame: 50,000 points 0 to 0.01 (shallow)
and 0 to 0.04 (deep) below the surface, and the trajectory of the default configuration. Of
points uniform in the box: the largest force in free space (ghost), its share of such points
(ghosts), and the error below the band of training as a share of the force there (core).
"""

import csv
import hashlib
import queue
import sys
import threading
import time
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import torch
import yaml
from common import SCANS, load, notes
from runs import expand

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.progress import Context
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.sampling import probes
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.spec import TrainTask
from pandis.pipeline.kinds.network.training.batches import TrainingPoints
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.ask.options import SampleOptions, TrajectoryOptions
from pandis.pipeline.run.ask.recipes import RECIPES, ExactRecipe, PaperRecipe
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress

COLUMNS = ("mesh", "recipe", "options", "device", "steps", "seconds", "points_per_s", "bytes")
COLUMNS += ("shallow", "deep", "trajectory", "ghost", "ghosts", "core", "restarts")


class Scan:
    """A mesh with its samples and probe sets."""

    def __init__(self, path):
        mesh = np.load(path)
        self.body = body = Body(mesh["vertices"], mesh["faces"], UNIT)
        law = SampleOptions()
        self.strata = SharedStrata(body, law, 0)
        only = dict.fromkeys(("offsets", "shallow", "penetration", "bent", "core"), 0)
        only |= {"surface": 50_000, "box": 50_000}
        self.paper_strata = SharedStrata(body, law.model_copy(update=only), 0)
        arrays = self.strata.arrays(silent_progress)
        self.samples = Artifact("samples", arrays, self.strata.attributes())
        self.sets = probes(body, 50_000, seed=1)
        box = np.random.default_rng(3).uniform(-1, 1, (50_000, 3))
        distance, normal = body.distance.distance_and_normal(box)
        core = distance < -law.depth
        self.free, self.core = box[distance > 0], (box[core], distance[core], normal[core])
        path, _ = trace(body, TrajectoryOptions(), 2, progress=silent_progress)
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


class SharedStrata(Strata):
    """Strata whose fresh points several trainers draw once, for they depend on the block alone."""

    KEPT = 64

    def __init__(self, body, options, seed):
        super().__init__(body, options, seed)
        self._lock, self._blocks = threading.Lock(), OrderedDict()

    def fresh(self, block, size):
        """Return a block of points, drawn by whoever asks for it first."""
        with self._lock:
            found = self._blocks.get((block, size))
            mine = found is None
            if mine:
                found = self._blocks[block, size] = Future()
                while len(self._blocks) > self.KEPT:
                    self._blocks.popitem(last=False)
        if mine:
            try:
                found.set_result(super().fresh(block, size))
            except BaseException as error:
                found.set_exception(error)  # or the others would wait for ever
                raise
        return found.result()


class OutOfTimeError(Exception):
    """The time for all runs is over."""


class Training:
    """One network to train."""

    def __init__(self, run, scans, folder):
        self.mesh, self.recipe, *rest = run.split(":")
        pairs = [pair.split("=") for pair in rest[0].split(",")] if rest else []
        self.changes = {key: yaml.safe_load(value) for key, value in pairs}
        base = RECIPES.get(self.recipe, {"loss": "exact"})
        own = {k: v for k, v in self.changes.items() if k not in ("seed", "law")}
        model = PaperRecipe if (base | own)["loss"] == "paper" else ExactRecipe
        seed, recipe = self.changes.get("seed", 1), model(**base | own)
        self.task = TrainTask(kind="network", name=self.recipe, recipe=recipe, seed=seed)
        self.options = recipe.model_dump() | {"seed": seed, "recipe": self.recipe}
        named = self.options | ({"law": "paper"} if "law" in self.changes else {})
        key = hashlib.sha256(repr(named).encode()).hexdigest()[:12]
        self.checkpoint = folder / f"{self.mesh}-{self.recipe}.{key}.pt"
        self.weights = self.checkpoint.with_suffix(".npz")
        self.scans = scans

    def train(self, deadline=float("inf")):
        """Train it; return a row of the table, or None if there was no time to end, or no end."""
        scan = self.scans[self.mesh]
        strata = scan.paper_strata if "law" in self.changes else scan.strata
        context = Context(self.checkpoint, partial(_Until, deadline), log)
        trainer = Trainer(self.task, TrainingPoints(scan.samples, strata), context)
        try:
            arrays, attributes = trainer.run()
        except OutOfTimeError:
            trainer.keep()
            log(f"{self.checkpoint.stem}: {trainer.step:,} steps in {trainer.elapsed:.0f} s")
            return None
        except PandisError as error:
            log(f"{self.checkpoint.stem}: {error}")
            return None
        np.savez(self.weights, **arrays, options=repr(self.options | self.changes))
        trainer.finish()
        attributes |= UNIT.attributes()
        field = SirenField(self.recipe, Artifact("model", arrays, attributes))
        shown = self.options["batch"] * (2 if trainer.paper else 1) * trainer.step
        return {
            "mesh": self.mesh,
            "recipe": self.recipe,
            "options": " ".join(f"{k}={v}" for k, v in self.changes.items()),
            "device": trainer.device,
            "steps": trainer.step,
            "seconds": trainer.elapsed,
            "points_per_s": shown / trainer.elapsed,
            "bytes": field.bytes,
            "restarts": attributes["restarts"],
            **scan.errors(field),
        }


class _Until:
    """The progress of a run that ends when time is up."""

    def __init__(self, deadline, name, total, unit="steps"):
        del name, total, unit
        self.deadline = deadline

    def resume(self, done):
        """Say nothing."""

    def update(self, done, note=""):
        """End the run if time is up."""
        del done, note
        if time.monotonic() > self.deadline:
            raise OutOfTimeError


class Table:
    """A CSV file that rows are appended to."""

    def __init__(self, path):
        self.path, self.lock = Path(path), threading.Lock()
        self.path.parent.mkdir(parents=True, exist_ok=True)

    def append(self, row):
        """Write a row, and above the first one how it was measured."""
        log(row)
        with self.lock:
            new = not self.path.exists()
            with self.path.open("a", encoding="utf-8", newline="") as stream:
                writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
                if new:
                    gpu = torch.cuda.get_device_name() if row["device"] == "cuda" else None
                    stream.write(notes("training.py MESHES TABLE mesh:recipe:options…", gpu))
                    writer.writeheader()
                cells = {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()}
                writer.writerow(cells)


def log(text):
    """Say something at once."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main(folder, table, *words):
    """Do what the command line says."""
    settings = dict(w.split("=") for w in words if ":" not in w and "=" in w)
    runs = [run for w in words if ":" in w or w[0] == "@" for run in expand(w)]
    deadline = time.monotonic() + float(settings.get("seconds", "inf"))
    together, table = int(settings.get("together", 1)), Table(table)
    scans = {}
    for mesh in dict.fromkeys(run.split(":")[0] for run in runs):
        scans[mesh] = Scan(Path(folder) / f"{mesh}.npz")
    trainings = [Training(run, scans, table.path.parent) for run in runs]
    trainings = [one for one in trainings if not one.weights.exists()]

    def train(one):
        row = one.train(deadline) if time.monotonic() < deadline else None
        if row:
            table.append(row)

    if together == 1:
        for one in trainings:
            train(one)
        return
    # streams of their own, so that the runs' kernels may overlap
    lanes = queue.SimpleQueue()
    for _ in range(together):
        lanes.put(torch.cuda.Stream())

    def in_lane(one):
        lane = lanes.get()
        try:
            with torch.cuda.stream(lane):
                train(one)
        finally:
            lanes.put(lane)

    sys.setswitchinterval(1e-4)  # a step is a few launches: no thread may keep others waiting
    with ThreadPoolExecutor(together) as pool:
        for done in [pool.submit(in_lane, one) for one in trainings]:
            done.result()


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

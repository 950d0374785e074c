"""Trains a network of each shape that `presses.py` presses, as a file to press on.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/networks.py prepare NETWORKS
       .venv/bin/python tests/benchmarks/networks.py NETWORKS [cpu|cuda] [KEY=VALUE…] [SHAPE…]

NETWORKS is a folder. `prepare` repairs the meshes and keeps them there as {shape}.npz, so that the
machine that trains needs neither the scans nor the mesh libraries, but PyTorch, SciPy, pydantic
and a C compiler. From these the other call trains `pandis-exact` for 45,000 steps, of all shapes or
those that are named; a KEY is an option of the recipe, like steps=90000 or width=320. It writes
{shape}.pandis with the margins that the export stage gives, but does not compare it with the field
as that stage does; and prints a line for each: the steps, the seconds that they took, on what, and
the share of the force that is missing, of which `presses.py` allows MISSING_LIMIT. A training that
was interrupted, and is called again with the same options, goes on from its checkpoint.
"""

import sys
from pathlib import Path

import numpy as np
import torch
import yaml
from bodies import UNIT

from pandis.base.physical import Scale
from pandis.base.progress import Context
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.judge.servo.walls import compare, open_walls
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.spec import TrainTask
from pandis.pipeline.kinds.network.training.batches import TrainingPoints
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.ask.recipes import RECIPES, ExactRecipe
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField

RECIPE, STEPS, SEED = "pandis-exact", 45_000, 1


def prepare(folder):
    """Keep the meshes of all shapes, in the unit frame, and how long they are (m)."""
    from presses import SIZE, shapes  # needs the mesh libraries, training does not

    folder.mkdir(parents=True, exist_ok=True)
    for shape, (vertices, faces, *_) in shapes().items():
        np.savez(folder / f"{shape}.npz", vertices=vertices, faces=faces, size=SIZE)


def open_body(folder, shape):
    """Return the body of a shape that was prepared, and how long it is (m)."""
    path = folder / f"{shape}.npz"
    if not path.exists():
        raise SystemExit(f"{path} is not there: first run networks.py prepare {folder}")
    mesh = np.load(path)
    return Body(mesh["vertices"], mesh["faces"], UNIT), float(mesh["size"])


def train(body, recipe, checkpoint):
    """Train a network of a body; return it, and the trainer, which knows how long that took."""
    strata = Strata(body, SampleOptions(), 0)
    arrays = strata.arrays(silent_progress)
    samples = Artifact("samples", arrays, strata.attributes())
    task = TrainTask(kind="network", name=RECIPE, recipe=recipe, seed=SEED)
    context = Context(checkpoint, silent_progress, lambda text: None)
    trainer = Trainer(task, TrainingPoints(samples, strata), context)
    arrays, attributes = trainer.run()
    model = Artifact("model", arrays, attributes | UNIT.attributes())
    return SirenField(RECIPE, model), trainer


def export(field, body):
    """Return the file of a network, with 32-bit weights and the margins of its distances."""
    file = NativeField(native_bytes(field, {}))
    safe = clearance(lambda points: file.query(points)[::2], body.distance)
    return native_bytes(field, {}, safe=safe)


def missing_share(body, size, data):
    """Return the share of the force on a body that a file leaves out, as `presses.py` asks it."""
    exact, native = ExactField("exact", body), NativeField(data)
    walls = open_walls(exact, Scale(size, 400.0), 0)
    return compare(ExportedField("network", native), walls).missing


def main(folder, *words):
    """Train the networks of the shapes that the command line names."""
    options, named = {"steps": STEPS, "device": "cpu"}, []
    for word in words:
        key, is_option, value = word.partition("=")
        if word in ("cpu", "cuda"):
            options["device"] = word
        elif is_option:
            options[key] = yaml.safe_load(value)
        else:
            named.append(word)
    recipe = ExactRecipe(**RECIPES[RECIPE] | options)
    said = ",".join(f"{key}={value}" for key, value in options.items())
    for shape in named or [path.stem for path in sorted(folder.glob("*.npz"))]:
        body, size = open_body(folder, shape)
        field, trainer = train(body, recipe, folder / f"{shape}.{said}.pt")
        data = export(field, body)
        (folder / f"{shape}.pandis").write_bytes(data)
        trainer.finish()  # its checkpoint goes only now
        where = torch.cuda.get_device_name() if trainer.device == "cuda" else "CPU"
        share = missing_share(body, size, data)
        verdict = "" if share <= MISSING_LIMIT else ", more than is allowed"
        print(f"{shape} ({said}): {trainer.step:,} steps in {trainer.elapsed:.1f} s on {where}; "
              f"missing {share:.3g}{verdict}", flush=True)  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["prepare"]:
        prepare(Path(sys.argv[2]))
    else:
        main(Path(sys.argv[1]), *sys.argv[2:])

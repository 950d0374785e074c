"""Points per second of a training step, ours and a plain loop's; write a table.

Usage: .venv/bin/python tests/benchmarks/throughput.py MESHES TABLE [cpu|cuda]

MESHES is a folder that `training.py prepare` has made, TABLE a CSV file. All train the
default recipe's network with its loss and batch: ours with the drawing and labelling of its
points, ours on points that are there, and what one would write without care: torch layers,
the gradient by autograd, backward through it, Adam. Medians of seven turns. The last rows say
what products of the same shape take alone, and on a GPU what a step's kernels take.
"""

import csv
import itertools
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch
from common import notes
from training import Scan, log

from pandis.base.progress import Context
from pandis.pipeline.kinds.network.spec import TrainTask
from pandis.pipeline.kinds.network.training.batches import TrainingPoints
from pandis.pipeline.kinds.network.training.exact_loss import exact_loss
from pandis.pipeline.kinds.network.training.products import product
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.ask.recipes import ExactRecipe
from pandis.pipeline.run.job.stage import silent_progress

TURNS = 7
#: Products per step: forward, gradient, and four backward through both; two operations each.
OPERATIONS = 6 * 2
OURS, PLAIN = "ours, points drawn and labelled", "a plain loop, points at hand"
DRAWING = "drawing and labelling alone"
KERNELS = ("gemm", "elementwise", "reduce", "adam")


class Plain:
    """The loop that one would write first."""

    def __init__(self, options, omega, device):
        width, self.omega, self.options = options.width, omega, options
        sizes = [3, *[width] * options.depth, 1]
        layers = [torch.nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
        self.layers = torch.nn.ModuleList(layers).to(device)
        self.optimiser = torch.optim.Adam(self.layers.parameters(), options.learning_rate)

    def step(self, rows):
        """Learn from a batch."""
        points = rows[:, :3].clone().requires_grad_()
        h = points
        for layer in self.layers[:-1]:
            h = torch.sin(self.omega * layer(h))
        phi = self.layers[-1](h)[:, 0]
        (direction,) = torch.autograd.grad(phi.sum(), points, create_graph=True)
        loss = exact_loss(phi, direction, rows[:, 3], normal=rows[:, 4:7], options=self.options)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()


def seconds(work, steps, device):
    """Return how long some steps take."""
    if device == "cuda":
        torch.cuda.synchronize()
    start = time.perf_counter()
    for _ in range(steps):
        work()
    if device == "cuda":
        torch.cuda.synchronize()
    return (time.perf_counter() - start) / steps


def kernels(work, steps):
    """Return the seconds per step of each kind of GPU kernel."""
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CUDA]) as profile:
        seconds(work, steps, "cuda")
    found = defaultdict(float)
    for event in profile.key_averages():
        name = event.key.lower()
        kind = next((k for k in KERNELS if k in name), "other")
        found[kind] += event.device_time_total / 1e6 / steps
    return found


class Same:
    """The same batch at every step."""

    def __init__(self, rows):
        self.rows = rows

    def batch(self, step):
        """Return it."""
        del step
        return self.rows


def works_of(trainer, options, device):
    """Return what to measure: a function, and how often to call it, by what it is."""
    fresh, rows = trainer.batches, trainer.batches.batch(0).clone()
    plain, same = Plain(options, trainer.shape.omega, device), Same(rows)
    blocks = itertools.count()

    def ours(batches):
        trainer.batches = batches
        trainer._advance(0.5)

    width, layers = options.width, options.depth - 1
    a, b = (torch.randn(width, n, device=device) for n in (width, options.batch))
    return {
        # so many steps that every turn holds the drawing of its points
        OURS: (lambda: ours(fresh), fresh.per_block),
        "ours, points at hand": (lambda: ours(same), 32),
        PLAIN: (lambda: plain.step(rows), 32),
        "products of such shapes alone": (lambda: [product(a, b) for _ in range(6 * layers)], 32),
        DRAWING: (lambda: fresh._make(next(blocks)), 1),
    }


def main(folder, table, device="cpu"):
    """Measure, and write the table."""
    scan = Scan(Path(folder) / "bunny.npz")
    options = ExactRecipe(steps=10**6, device=device, threads=2)
    task = TrainTask(kind="network", name="pandis-exact", recipe=options, seed=1)
    context = Context(Path(table).with_suffix(".pt"), silent_progress, log)
    trainer = Trainer(task, TrainingPoints(scan.samples, scan.strata), context)
    batch, per_block = options.batch, trainer.batches.per_block
    works = works_of(trainer, options, device)
    for work, steps in works.values():
        seconds(work, min(steps, 8), device)
    taken = {what: [] for what in works}
    for turn in range(TURNS):
        for what, (work, steps) in works.items():
            taken[what].append(seconds(work, steps, device))
        log(f"turn {turn + 1} of {TURNS}: " + str({w: f"{t[-1]:.4g}" for w, t in taken.items()}))
    taken = {what: float(np.median(times)) for what, times in taken.items()}
    taken[DRAWING] /= per_block
    work = OPERATIONS * (options.depth - 1) * options.width**2 * batch / 1e9
    lines = []
    for what, s in taken.items():
        rates = ["", ""] if what == DRAWING else [taken[PLAIN] / s, work / s]
        lines.append((what, s * 1e3, batch / s, *rates))
    if device == "cuda":
        large = torch.randn(8192, 8192, device=device)
        best = min(seconds(lambda: large @ large, 5, device) for _ in range(5))
        lines.append(("a product of 8192 x 8192", best * 1e3, "", "", 2 * 8192**3 / 1e9 / best))
        parts = kernels(works["ours, points at hand"][0], 50)
        for kind, s in sorted(parts.items(), key=lambda item: -item[1]):
            lines.append((f"kernels of a step: {kind}", s * 1e3, "", "", ""))
    with Path(table).open("w", encoding="utf-8", newline="") as stream:
        gpu = torch.cuda.get_device_name() if device == "cuda" else None
        stream.write(notes(f"throughput.py MESHES TABLE {device}", gpu))
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("what", "ms", "points_per_s", "ratio", "gflops"))
        for line in lines:
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in line])


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Hash grids beside compact meshes, splines and networks of their size; docs/figures/hashgrid.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/hashgrid.py prepare MODELS
       .venv/bin/python tests/benchmarks/hashgrid.py train MODELS [grids|networks]
       .venv/bin/python tests/benchmarks/hashgrid.py measure MODELS

A hash grid looks features up in tables of several resolutions, interpolates them, and gives them to
a small network (Mueller et al. 2022, "Instant neural graphics primitives with a multiresolution
hash encoding"). Here the network returns distance and normal, as `pandis-exact` does, and learns
them from the same exact labels; tables and weights are stored with 16 bits. `train` needs a GPU, a
C compiler, PyTorch, SciPy and pydantic, and no mesh library: it tries several shapes of tables on
the bunny, trains the best of each size on every scan, and `pandis-exact` of the same bytes.
`measure` asks all of them, and compact meshes and splines made for these bytes, the same questions
(mean errors of the force, k = 1, unit frame), and times single queries in C.
"""

import ctypes
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from common import SCANS, load, write

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.base.physical import Scale
from pandis.engine.compiler import FLAGS
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField

BUDGETS = 40_000, 100_000, 400_000, 800_000
FEATURES, COARSEST = 2, 8
#: Levels, finest resolution and width of the network that are tried for each size.
SHAPES = {
    40_000: ((6, 48, 16), (8, 64, 16), (8, 96, 32), (10, 64, 16)),
    100_000: ((8, 64, 32), (8, 96, 32), (8, 128, 32), (10, 96, 32)),
    400_000: ((8, 128, 64), (10, 128, 64), (10, 192, 64), (12, 192, 64)),
    800_000: ((8, 192, 64), (10, 192, 64), (12, 192, 64), (12, 256, 64)),
}
STEPS, TRIAL, BATCH, POOL = 10_000, 2_000, 1 << 15, 1 << 22
PRIMES = 1, 2654435761, 805459861
#: Widths of `pandis-exact`, four layers, with about these bytes.
WIDTHS = {40_000: 56, 100_000: 90, 400_000: 181, 800_000: 256}
COLUMNS = (
    *("mesh", "kind", "budget", "bytes", "shape", "build_s"),
    *("shallow", "deep", "contact", "missing", "one_us"),
)


class HashGrid(torch.nn.Module):
    """Tables of features at several resolutions, and a network of two hidden layers."""

    def __init__(self, budget, shape):
        super().__init__()
        self.shape = levels, finest, width = shape
        growth = (finest / COARSEST) ** (1 / max(levels - 1, 1))
        self.sizes = [int(COARSEST * growth**k + 1e-6) for k in range(levels)]
        layers = levels * FEATURES, width, width, 4
        self.layers = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in pairwise(layers))
        weights = sum(p.numel() for p in self.layers.parameters())
        left = budget // 2 - weights
        # the largest limit of a table with which all fit
        wanted = [(size + 1) ** 3 * FEATURES for size in self.sizes]
        low, high = 0, max(wanted)
        while low < high:
            middle = (low + high + 1) // 2
            if sum(min(w, middle) for w in wanted) <= left:
                low = middle
            else:
                high = middle - 1
        entries = [min(w, low) // FEATURES for w in wanted]
        self.bytes = 2 * (weights + sum(entries) * FEATURES)
        starts = np.concatenate([[0], np.cumsum(entries)])
        self.register_buffer("size", torch.tensor(self.sizes))
        self.register_buffer("entries", torch.tensor(entries))
        self.register_buffer("start", torch.tensor(starts[:-1]))
        self.register_buffer("hashed", self.entries < (self.size + 1) ** 3)
        self.register_buffer("corner", torch.tensor([[i >> k & 1 for k in range(3)]
                                                     for i in range(8)]))  # fmt: skip
        self.table = torch.nn.Parameter(
            torch.empty(int(starts[-1]), FEATURES).uniform_(-1e-4, 1e-4)
        )

    def forward(self, points):
        """Return distance and direction (n, 4) at points (n, 3)."""
        place = ((points + 1) / 2).clamp(0, 1)[:, None] * self.size[:, None]
        cell = torch.minimum(place.floor().long(), self.size[:, None] - 1)
        part = place - cell
        node = cell[:, :, None] + self.corner
        dense = self.size[:, None] + 1
        straight = (node[..., 2] * dense + node[..., 1]) * dense + node[..., 0]
        mixed = node[..., 0] ^ node[..., 1] * PRIMES[1] ^ node[..., 2] * PRIMES[2]
        index = torch.where(self.hashed[:, None], (mixed & 0xFFFFFFFF) % self.entries[:, None],
                            straight)  # fmt: skip
        values = self.table[index + self.start[:, None]]
        share = torch.where(self.corner.bool(), part[:, :, None], 1 - part[:, :, None]).prod(-1)
        x = (values * share[..., None]).sum(2).flatten(1)
        for layer in self.layers[:-1]:
            x = torch.relu(layer(x))
        return self.layers[-1](x)

    def rounded(self):
        """Round tables and weights to 16 bits; return this grid."""
        with torch.no_grad():
            for p in self.parameters():
                p.copy_(p.half().float())
        return self


def loss_of(output, distance, normal):
    """Return the mean bound on the error of the force, and a little of that of the normal."""
    direction = torch.nn.functional.normalize(output[:, 1:], dim=1)
    off = (direction - normal).norm(dim=1)
    near = torch.exp(-distance.abs() / 0.02)
    return ((output[:, 0] - distance).abs() * (1 + 4 * near) + (distance.abs() + 0.01) * off).mean()


def train_grid(rows, budget, shape, *, steps, device):
    """Train a hash grid on rows (n, 7) of points, distances and normals; return it, and seconds."""
    torch.manual_seed(0)
    grid = HashGrid(budget, shape).to(device)
    groups = [{"params": [grid.table]}, {"params": grid.layers.parameters()}]
    optimiser = torch.optim.Adam(groups, betas=(0.9, 0.99), eps=1e-15, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, [1e-2, 3e-3], total_steps=steps, pct_start=0.05, final_div_factor=1e3
    )
    begin, rng = time.perf_counter(), torch.Generator(device).manual_seed(1)
    for _ in range(steps):
        chosen = rows[torch.randint(len(rows), (BATCH,), device=device, generator=rng)]
        optimiser.zero_grad(set_to_none=True)
        loss_of(grid(chosen[:, :3]), chosen[:, 3], chosen[:, 4:7]).backward()
        optimiser.step()
        schedule.step()
    torch.cuda.synchronize()
    return grid.rounded(), time.perf_counter() - begin


def open_body(folder, name):
    """Return the body of a scan that was prepared."""
    mesh = np.load(folder / f"{name}.npz")
    return Body(mesh["vertices"], mesh["faces"], UNIT)


def train_grids(folder):
    """Choose a shape for each size on the bunny, and train it on every scan."""
    device, chosen = "cuda", {}
    print(torch.cuda.get_device_name(), flush=True)
    for name in SCANS:
        begin = time.perf_counter()
        strata = Strata(open_body(folder, name), SampleOptions(), 0)
        fresh = np.concatenate([strata.fresh(block, POOL // 4) for block in range(4)])
        rows = torch.tensor(fresh, device=device)
        held = torch.tensor(strata.fresh(4, POOL // 8), device=device)
        print(f"{name}: {len(rows):,} points in {time.perf_counter() - begin:.1f} s", flush=True)
        for budget, shapes in SHAPES.items():
            if budget not in chosen:
                tried = {}
                for shape in shapes:
                    grid, seconds = train_grid(rows, budget, shape, steps=TRIAL, device=device)
                    with torch.no_grad():
                        tried[shape] = float(np.mean([
                            float(loss_of(grid(part[:, :3]), part[:, 3], part[:, 4:7]))
                            for part in held.split(BATCH)]))  # fmt: skip
                    print(budget, shape, f"{1e3 * tried[shape]:.3f}e-3 {seconds:.1f} s", flush=True)
                chosen[budget] = min(tried, key=tried.get)
            grid, seconds = train_grid(rows, budget, chosen[budget], steps=STEPS, device=device)
            state = {"shape": chosen[budget], "seconds": seconds, "state": grid.half().state_dict()}
            torch.save(state, folder / f"{name}.{budget}.pt")
            print(name, budget, chosen[budget], f"{seconds:.1f} s", flush=True)


def train_networks(folder):
    """Train `pandis-exact` of each size on every scan."""
    from networks import RECIPE, RECIPES, STEPS, ExactRecipe, export, train

    for name in SCANS:
        body = open_body(folder, name)
        for budget, width in WIDTHS.items():
            target = folder / f"{name}.{budget}.pandis"
            if target.exists():  # of a call that was interrupted
                continue
            options = {"steps": STEPS, "device": "cuda", "width": width}
            recipe = ExactRecipe(**RECIPES[RECIPE] | options)
            field, trainer = train(body, recipe, target.with_suffix(".checkpoint"))
            target.with_suffix(".seconds").write_text(f"{trainer.elapsed}")
            target.write_bytes(export(field, body))
            trainer.finish()
            print(name, budget, width, f"{trainer.elapsed:.1f} s", flush=True)


class Stored:
    """A trained hash grid on the CPU: forces at points, and single queries in C."""

    def __init__(self, path, budget):
        data = torch.load(path, map_location="cpu", weights_only=True)
        self.grid = HashGrid(budget, tuple(data["shape"])).half()
        self.grid.load_state_dict(data["state"])
        self.grid.float()
        self.seconds = data["seconds"]

    def force(self, points):
        """Return the forces (n, 3) at points (n, 3)."""
        with torch.no_grad():
            blocks = torch.tensor(points).float().split(1 << 14)
            answer = np.concatenate([self.grid(block).numpy() for block in blocks])
        direction = answer[:, 1:].astype(np.float64)
        normal = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return penalty_force(answer[:, 0].astype(np.float64), normal)

    def microseconds(self, points):
        """Return the median time (µs) of a query in C."""
        grid, points = self.grid, np.ascontiguousarray(points, np.float32)
        parts = [grid.table, *(p for layer in grid.layers for p in (layer.weight.T, layer.bias))]
        numbers = np.concatenate([part.detach().numpy().ravel() for part in parts])
        levels = torch.stack([grid.size, grid.entries, grid.start], dim=1).numpy().copy()
        answers, times = np.empty((len(points), 4), np.float32), np.empty(len(points))
        compiled().ask(
            numbers.ctypes.data, levels.ctypes.data, len(levels), grid.shape[2],
            points.ctypes.data, len(points), answers.ctypes.data, times.ctypes.data,
        )  # fmt: skip
        with torch.no_grad():
            expected = grid(torch.tensor(points))
            expected[:, 1:] = torch.nn.functional.normalize(expected[:, 1:], dim=1)
        assert np.abs(answers - expected.numpy()).max() < 1e-4, "C and PyTorch differ"
        return 1e6 * float(np.median(times))


def compiled():
    """Return the program of single queries, compiled."""
    path = Path(tempfile.mkdtemp()) / "hashgrid.so"
    source = Path(__file__).with_name("hashgrid.c")
    command = ["cc", "-march=native", *FLAGS, "-D_GNU_SOURCE", "-shared", "-fPIC"]
    subprocess.run([*command, source, "-o", path, "-lm"], check=True)
    library = ctypes.CDLL(str(path))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    library.ask.argtypes = [pointer, pointer, count, count, pointer, count, pointer, pointer]
    return library


def candidates(folder, name, budget, *, points, path):
    """Yield the kind, the force and the figures of everything of a size."""
    from pandis.pipeline.kinds.compact.search import Packer
    from pandis.pipeline.kinds.exported import ExportedField
    from pandis.pipeline.kinds.native import native_bytes
    from pandis.pipeline.kinds.spline.search import SplineMaker

    grid = Stored(folder / f"{name}.{budget}.pt", budget)
    shape = "{} levels to {}, width {}".format(*grid.grid.shape)
    figures = {"bytes": grid.grid.bytes, "build_s": grid.seconds, "shape": shape}
    yield "hash grid", grid.force, figures | {"one_us": grid.microseconds(path)}
    file = folder / f"{name}.{budget}.pandis"
    seconds = float(file.with_suffix(".seconds").read_text())
    network = ExportedField("pandis-exact", file)
    figures = {"bytes": network.bytes, "build_s": seconds, "shape": f"4 x {WIDTHS[budget]}"}
    yield "pandis-exact", _force(network), figures | {"one_us": _microseconds(network.file, path)}
    for kind in ("compact-auto", "spline-auto"):
        start = time.perf_counter()
        if kind == "compact-auto":
            made = Packer(points, 1, lambda text: None).within(budget)
        else:
            made = SplineMaker(points, (0.045, 0.02), silent_progress, most=budget).make(budget)
        if made is None:
            continue
        seconds, field = time.perf_counter() - start, NativeField(native_bytes(made.field, {}))
        figures = {"bytes": field.bytes, "build_s": seconds, "one_us": _microseconds(field, path)}
        yield kind, made.force, figures


def measure(folder):
    """Ask everything the same questions."""
    from pandis.pipeline.geometry.points import Points
    from pandis.pipeline.geometry.sampling import probes

    rows = []
    for name in SCANS:
        body = open_body(folder, name)
        points = Points(body, Scale(0.1, 400.0), 1)
        sets = probes(body, 50_000, seed=1)
        same = {"points": points, "path": sets["deep"][0][:2000]}
        for budget in BUDGETS:
            for kind, force, figures in candidates(folder, name, budget, **same):
                row = {"mesh": name, "kind": kind, "budget": budget} | figures
                for where, (place, distance, normal) in sets.items():
                    off = force(place) - penalty_force(distance, normal)
                    row[where] = float(np.linalg.norm(off, axis=1).mean())
                told = points.measure(force).figures
                rows.append(row | {"contact": told["mean"], "missing": told["missing"]})
                print(rows[-1], file=sys.stderr, flush=True)
    write("hashgrid", COLUMNS, rows)


def _microseconds(field, points):
    """Return the median time (µs) of a query in C, each point's least of seven."""
    times = [field.time(points, len(points)) for _ in range(7)]
    return 1e6 * float(np.median(np.min(times, axis=0)))


def _force(field):
    def force(points):
        answer = field.query(points)
        return penalty_force(answer.distance, answer.normal)

    return force


def main(command, folder, what=""):
    folder = Path(folder)
    if command == "prepare":
        folder.mkdir(parents=True, exist_ok=True)
        for name, source in SCANS.items():
            vertices, faces = load(source)
            np.savez(folder / f"{name}.npz", vertices=vertices, faces=faces)
    elif command == "train":
        if what != "networks":
            train_grids(folder)
        if what != "grids":
            train_networks(folder)
    else:
        measure(folder)


if __name__ == "__main__":
    main(*sys.argv[1:])

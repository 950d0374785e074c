"""pandis.h against the usual ways to ask the same fields; write docs/figures/native.csv.

Usage: .venv/bin/python tests/benchmarks/native.py

The mesh is the bunny that ships with PyMeshLab, the points are those of the default trajectory, one
query at a time on one thread; networks also answer 10,000 points in one call from Python.
Everything takes turns in one process; figures are medians of all queries of five turns. The
networks are untrained, of the paper's size (four layers of 256), with four outputs and with one and
its gradient: what they answer does not matter to the clock.

Floors, measured beside them by floor.c: what a query reads, at the rate at which as many bytes as
the field has come through the caches; and the multiplications and additions of a network at the
rate of a loop that does nothing else.
"""

import ctypes
import os
import sys
import time
from functools import cache
from pathlib import Path

import igl
import numpy as np
import torch
from common import write

from pandis.base.frame import UNIT, Frame
from pandis.engine.compiler import build, find_compiler, load
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.network.graph import network_graph
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.training.network import Siren, named_arrays
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.session import Session
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.mesh.build import build as build_mesh
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.field.binding import SOURCE, declared

TURNS, QUERIES, BATCH = 5, 2000, 10_000
UNIT_AT = UNIT.attributes()
COLUMNS = ("field", "way", "median_us", "p999_us", "bytes", "of_native")


def bunny():
    """Return the bunny's vertices and faces in the unit frame."""
    task = MeshTask(source="pymeshlab:bunny.obj", sha256=None, seed=0)
    arrays, _ = build_mesh(task, None, lambda text: None)
    frame = Frame.of_bounds(arrays["vertices"].min(0), arrays["vertices"].max(0))
    return frame.to_unit(arrays["vertices"]), arrays["faces"]


def fields(vertices, faces):
    """Yield name, kind and field of all that is asked."""
    body = Body(vertices, faces, UNIT)
    yield "exact", "exact", ExactField("exact", body)
    for kind in ("nearest", "trilinear", "tricubic"):
        made = DenseGrid(
            body.distance, CONTENTS[kind], 64, band=(0.045, 0.02), progress=silent_progress
        )
        values = {"values": np.concatenate(list(made.slabs(64)))}
        held = Artifact("grid", values, made.attributes() | UNIT_AT)
        yield f"{kind}-64", kind, open_field(parse_field(f"{kind}-64", ()), held)
    fitted = SplineFit(body, (0.045, 0.02), 0, count=samples_for(budget=800_000))
    arrays, attributes = fitted.build(fitted.choose_size(800_000), 800_000, silent_progress)
    held = Artifact("grid", arrays, attributes | UNIT_AT)
    yield "spline-auto", "spline", open_field(parse_field("spline-auto", ()), held)
    for outputs in (4, 1):
        network = Siren(256, 4, 30.0, outputs=outputs, generator=torch.Generator().manual_seed(0))
        shape = {"width": 256, "depth": 4, "omega": 30.0, "outputs": outputs}
        weights = named_arrays(list(network.parameters()))
        held = Artifact("model", weights, UNIT_AT | {"architecture": shape})
        name = "network 4×256" if outputs == 4 else "network 4×256, gradient"
        yield name, (held, network), SirenField(name, held)


#: Bytes of coefficients that a query of a grid reads.
READ = {"nearest-64": 12, "trilinear-64": 96, "tricubic-64": 256, "spline-auto": 192}
SIZES = {"nearest-64": 3145728, "trilinear-64": 3145728, "tricubic-64": 1048576}


def floors():
    """Yield field, way and microseconds of what no query can be faster than."""
    library = load(Path(__file__).with_name("floor.c"))
    library.floor_read.restype = library.floor_arithmetic.restype = ctypes.c_double
    library.floor_read.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]
    library.floor_arithmetic.argtypes = [ctypes.c_void_p]
    sink = np.zeros(1, np.float32)

    def read(size):
        data = np.ones(size // 4, np.float32)
        return library.floor_read(data.ctypes.data, len(data), sink.ctypes.data)

    for name, size in READ.items():
        whole = SIZES.get(name, 800_000)
        yield name, "floor: its bytes", 1e6 * read(whole) * size / whole
    rate = library.floor_arithmetic(sink.ctypes.data)
    hidden = 3 * 256 * 256
    for name, passes in (("network 4×256", 1), ("network 4×256, gradient", 2)):
        yield name, "floor: its bytes", 1e6 * passes * read(4 * hidden)
        yield name, "floor: its arithmetic", 1e6 * passes * 2 * hidden / rate


@cache
def compiled_plainly():
    """Return what asks pandis.h, as a user compiles it who gives no flags but -O2."""
    command = [find_compiler(), "-std=c99", "-O2", "-fPIC", "-shared"]
    return declared(ctypes.CDLL(build(command, SOURCE, ["-lm", "-lpthread"], name="plain.so")))


def one_by_one(answer, points):
    """Return the seconds of single queries."""
    clock, taken = time.perf_counter, np.empty(QUERIES)
    single = [points[k % len(points)][None].copy() for k in range(QUERIES)]
    for k, point in enumerate(single):
        start = clock()
        answer(point)
        taken[k] = clock() - start
    return taken


def together(answer, points):
    """Return the seconds per point of a query of many points."""
    many = np.resize(points, (BATCH, 3))
    start = time.perf_counter()
    answer(many)
    return np.array([(time.perf_counter() - start) / BATCH])


def eager(network):
    """Return what asks a network in PyTorch."""

    @torch.no_grad()
    def answer(point):
        unit = torch.from_numpy(point).float()
        if network.weights[-1].shape[0] == 4:
            out = network(unit)
            return out[:, 0], torch.nn.functional.normalize(out[:, 1:])
        phi, slope = network.forward_with_gradient(unit)
        return phi[:, 0], torch.nn.functional.normalize(slope)

    return answer


def ways(vertices, faces):
    """Yield field, way, bytes and what times it."""
    path = {}
    for name, kind, field in fields(vertices, faces):
        if name == "exact":
            path, _ = trace(field.body, TrajectoryOptions(), 2, progress=silent_progress)
        points = path["points"]
        network = not isinstance(kind, str)
        for bits in (32, 16) if network else (32,):
            data = native_bytes(field, {}, bits)
            native = NativeField(data)
            way = "pandis.h" if bits == 32 else "pandis.h, 16-bit weights"
            yield name, way, len(data), lambda n=native, p=points: n.time(p, QUERIES)
            plain = NativeField(data)
            plain._library = compiled_plainly()
            yield name, f"{way}, by -O2 alone", "", lambda n=plain, p=points: n.time(p, QUERIES)
        if name == "exact":
            tree = igl.AABB()
            mesh = vertices, faces.astype(np.int64)
            tree.init(*mesh)
            asked = lambda p, t=tree, m=mesh: t.squared_distance(*m, p)  # noqa: E731
            yield name, "igl.AABB", "", lambda a=asked, p=points: one_by_one(a, p)
            scan = lambda p, e=field.engine: e.scan(p)  # noqa: E731
            yield name, "all faces, in C", "", lambda a=scan, p=points[::20]: one_by_one(a, p)
        if network:
            held, module = kind
            session = Session(network_graph(held).model(name, {})).distance_and_normal
            asked = NativeField(native_bytes(field, {})).query
            yield name, "pandis.h, from Python", "", lambda a=asked, p=points: one_by_one(a, p)
            yield name, "ONNX Runtime", "", lambda a=session, p=points: one_by_one(a, p)
            for way, a in (("pandis.h", asked), ("ONNX Runtime", session)):
                yield name, f"{way}, {BATCH:,} points", "", lambda a=a, p=points: together(a, p)
            asked = eager(module)
            yield name, "PyTorch, eager", "", lambda a=asked, p=points: one_by_one(a, p)


def main():
    """Measure, and write the table."""
    torch.set_num_threads(1)
    os.environ["IGL_NUM_THREADS"] = "1"
    every = list(ways(*bunny()))
    seconds = [[] for _ in every]
    for turn in range(TURNS):
        for index, (name, way, _, clock) in enumerate(every):
            seconds[index].append(clock())
            print(f"turn {turn + 1}: {name}, {way}", file=sys.stderr, flush=True)
    rows, native = [], {}
    for (name, way, size, _), turns in zip(every, seconds, strict=True):
        found = np.concatenate(turns) * 1e6
        middle = float(np.median(found))
        native.setdefault(name, middle)
        rows.append(
            {
                "field": name,
                "way": way,
                "median_us": middle,
                "p999_us": float(np.percentile(found, 99.9)),
                "bytes": size,
                "of_native": middle / native[name],
            }
        )
    for name, way, least in floors():
        row = {"field": name, "way": way, "median_us": least, "of_native": least / native[name]}
        last = max(index for index, own in enumerate(rows) if own["field"] == name)
        rows.insert(last + 1, row)
    write("native", COLUMNS, rows)


if __name__ == "__main__":
    main()

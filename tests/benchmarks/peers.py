"""Distances from meshes: pandis beside Embree, fcpw and Open3D; write docs/figures/peers.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/peers.py

Needs fcpw and open3d in the environment, and Embree 3 with its headers. All run on one core, each
in turn, with the same points: of the default trajectory (path), up to 2 of 100 mm from the surface
(near), in the box (box), and at most a hundredth from its middle (centre). Figures are microseconds
a query: `mean_us` is the median of the turns' means, and the others are of single queries, the
fastest of all turns at each point, which only ways in C can state. Packages for Python answer all
points in one call. fcpw has no signed distance from Python without its own normals: the second of
its rows adds its test of containment.
"""

import ctypes
import os
import sys
from pathlib import Path
from time import perf_counter

import fcpw
import numpy as np
import open3d
from common import SCANS, load, write
from signs import fcpw_scene
from worst import bodies, joined

from pandis.base.frame import UNIT
from pandis.engine.compiler import build, find_compiler
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

TURNS, POINTS = 5, 8_000
COLUMNS = ("mesh", "points", "way", "mean_us", "median_us", "p999_us", "worst_us", "of_exact")


def drawn(body):
    """Yield the name and points of each set."""
    rng = np.random.default_rng(0)
    path, _ = trace(body, TrajectoryOptions(), 2, progress=silent_progress)
    yield "path", path["points"][:POINTS]
    points, normals, _, _ = Surface(body.vertices, body.faces).draw(POINTS, rng)
    yield "near", points + rng.uniform(-0.036, 0.036, (POINTS, 1)) * normals
    yield "box", rng.uniform(-1, 1, (POINTS, 3))
    middle = (body.vertices.min(0) + body.vertices.max(0)) / 2
    yield "centre", middle + rng.uniform(-0.01, 0.01, (400, 3))


def of_pandis(data):
    """Return what asks a file, one query at a time, in C."""
    field = NativeField(data)
    return lambda points: (field.query(points).distance, field.time(points, len(points)))


def of_embree(vertices, faces):
    """Return what asks Embree, one query at a time, in C."""
    command = [find_compiler(), "-O3", "-march=native", "-shared", "-fPIC"]
    source = Path(__file__).with_name("embree.c")
    library = ctypes.CDLL(build(command, source, ["-lembree3", "-lm"], name="embree.so"))
    number = ctypes.c_size_t
    library.embree_scene.restype = ctypes.c_void_p
    mesh = [pointed(vertices, np.float32), pointed(faces, np.int32)]
    scene = library.embree_scene(mesh[0], number(len(vertices)), mesh[1], number(len(faces)))

    def ask(points):
        far, taken = np.empty(len(points), np.float32), np.empty(len(points))
        arguments = pointed(points, np.float32), number(len(points)), far.ctypes, taken.ctypes
        library.embree_query(ctypes.c_void_p(scene), *mesh, *arguments)
        return far, taken

    return ask


def pointed(array, kind):
    """Return an array as an argument of a function in C."""
    return np.ascontiguousarray(array, kind).ctypes


def in_one_call(answer):
    """Return what asks a package for Python, all points in one call."""

    def ask(points):
        start = perf_counter()
        answered = answer(points)
        taken = perf_counter() - start
        if not isinstance(answered, np.ndarray):
            answered = np.array([one.d for one in answered])
        return answered, np.full(len(points), taken / len(points))

    return ask


def of_fcpw(vertices, faces, inside):
    """Return what asks fcpw for distances, and whether points are inside, or not."""
    scene = fcpw_scene(vertices, faces, vectorize=True)

    def answer(points):
        rows = np.asfortranarray(points, np.float32)
        nearest, contained = fcpw.interaction_3D_list(), np.zeros(len(points), np.int32)
        scene.find_closest_points(rows, np.full(len(points), np.inf, np.float32), nearest)
        if inside:
            scene.contains(rows, contained)
        return nearest

    return in_one_call(answer)


def of_open3d(vertices, faces):
    """Return what asks Open3D for signed distances."""
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))

    def answer(points):
        rows = open3d.core.Tensor(points.astype(np.float32))
        return scene.compute_signed_distance(rows, nthreads=1).numpy()

    return in_one_call(answer)


def ways(body):
    """Return what asks for distances from a body, each in its way."""
    packed = file_parts(*build_compact(body, 16, 0, log=lambda text: None))
    mesh = body.vertices, body.faces
    return {
        "pandis exact": of_pandis(native_bytes(ExactField("exact", body), {})),
        "pandis compact-16": of_pandis(pack(UNIT, packed, {}, version=3)),
        "Embree 3, unsigned": of_embree(*mesh),
        "fcpw, unsigned": of_fcpw(*mesh, inside=False),
        "fcpw, and whether inside": of_fcpw(*mesh, inside=True),
        "Open3D, signed": of_open3d(*mesh),
    }


def measure(name, vertices, faces):
    """Yield the rows of a mesh."""
    body = Body(vertices, faces, UNIT)
    asked = ways(body)
    for where, points in drawn(body):
        taken, exact = {way: [] for way in asked}, None
        for _ in range(TURNS):
            for way, ask in asked.items():
                distance, seconds = ask(points)
                taken[way].append(seconds * 1e6)
                exact = distance if way == "pandis exact" else exact
                allowed = 2e-3 if way == "pandis compact-16" else 1e-3  # single precision, slivers
                off = np.abs(np.abs(distance) - np.abs(exact)).max()
                assert off < allowed, f"{where}, {way}: {off}"
        base = np.median(np.mean(taken["pandis exact"], axis=1))
        for way, turns in taken.items():
            mean = float(np.median(np.mean(turns, axis=1)))
            row = {"mesh": name, "points": where, "way": way, "mean_us": mean,
                   "of_exact": float(mean / base)}  # fmt: skip
            if np.ptp(turns[0]):
                single = np.min(turns, axis=0)
                row |= {"median_us": float(np.median(single)), "worst_us": float(single.max()),
                        "p999_us": float(np.percentile(single, 99.9))}  # fmt: skip
            print(row, file=sys.stderr, flush=True)
            yield row


def main():
    """Measure all meshes."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    rows = []
    for name, source in SCANS.items():
        rows += measure(name, *load(source))
    name, vertices, faces = next(bodies())
    rows += measure(name, *joined(vertices, faces))
    os.sched_setaffinity(0, cores)
    write("peers", COLUMNS, rows)


if __name__ == "__main__":
    main()

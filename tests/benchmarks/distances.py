"""Speed and memory of exact distances, samples and grids; write docs/figures/distances.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/distances.py
Rates are medians of five runs that take turns, on the same points, with all cores. Memory is
the peak of a process that does nothing else.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import igl
import numpy as np
from common import SCANS, load, write

from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.distance import MeshDistance
from pandis.pipeline.geometry.sampling import Surface
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.job.artifact import ArtifactWriter
from pandis.pipeline.run.job.stage import silent_progress

COLUMNS = ("what", "case", "value", "unit", "ratio")
BAND = (0.045, 0.02)
SIZES = (64, 128, 256, 512)
#: Faces of the mesh that is subdivided: 9,000, four times as many, and so on.
SUBDIVIDED = "watertight/fertility_4494v_9000f.off"


def labels(vertices, faces, rows, order):
    """Label a million points near the surface: ours against libigl's signed distance."""
    engine = MeshDistance(vertices, faces)
    rng = np.random.default_rng(0)
    points, normals, _, _ = Surface(vertices, faces).draw(1_000_000, rng)
    points = points + rng.normal(0, 0.01, (len(points), 1)) * normals
    if order == "in no order":
        points = rng.permutation(points)
    corners, kind = faces.astype(np.int64), igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    ways = {
        "ours, every sign checked": lambda: engine.distance_and_normal(points),
        "ours, and faces, barycentrics, ties": lambda: engine.label(points),
        "ours, unchecked": lambda: engine.distance_and_normal(points, check=False),
        "igl.signed_distance, pseudonormals": lambda: igl.signed_distance(
            points, vertices, corners, sign_type=kind
        ),
    }
    seconds = {name: [] for name in ways}
    for _ in range(5):
        for name, way in ways.items():
            start = time.perf_counter()
            way()
            seconds[name].append(time.perf_counter() - start)
    base = np.median(seconds["igl.signed_distance, pseudonormals"])
    for name, found in seconds.items():
        middle = float(np.median(found))
        row = {
            "what": f"labels of points {order}",
            "case": name,
            "value": 1e6 / middle,
            "unit": "points/s",
        }
        rows.append(row | {"ratio": float(base / middle)})


def one_query(vertices, faces, rows):
    """Ask for one point at a time, from Python."""
    engine = MeshDistance(vertices, faces)
    tree = igl.AABB()
    tree.init(vertices, faces.astype(np.int64))
    corners = faces.astype(np.int64)
    rng = np.random.default_rng(0)
    points = Surface(vertices, faces).draw(2000, rng)[0] + rng.normal(0, 0.01, (2000, 3))
    ways = {
        "ours": lambda p: engine.distance_and_normal(p, check=False),
        "igl.AABB, no sign": lambda p: tree.squared_distance(vertices, corners, p),
    }
    for name, way in ways.items():
        took = []
        for point in points:
            start = time.perf_counter()
            way(point[None])
            took.append(time.perf_counter() - start)
        middle = 1e6 * float(np.median(took))
        rows.append({"what": "one query", "case": name, "value": middle, "unit": "µs"})


def grid_seconds(vertices, faces, size):
    """Return the seconds to build the tree and bake the distance grid, least of three."""
    took = []
    for _ in range(3 if size < 512 else 1):
        start = time.perf_counter()
        grid = DenseGrid(
            MeshDistance(vertices, faces), "distance", size, band=BAND, progress=silent_progress
        )
        for _ in grid.slabs(32):
            pass
        took.append(time.perf_counter() - start)
    return float(np.median(took))


def grids(vertices, faces, rows):
    """Bake the distance grid at growing sizes, and on a mesh with growing numbers of faces."""
    seconds = {size: grid_seconds(vertices, faces, size) for size in SIZES}
    for size in SIZES:
        row = {"what": "grid by size", "case": f"{size}³", "value": seconds[size], "unit": "s"}
        if size > 64:
            row["ratio"] = float(np.log2(seconds[size] / seconds[size // 2]))
        rows.append(row)
    vertices, faces = load(SUBDIVIDED)
    first = None
    for _ in range(5):
        now = grid_seconds(vertices, faces, 128)
        row = {"what": "128³ by faces", "case": f"{len(faces):,}", "value": now, "unit": "s"}
        if first:
            row["ratio"] = float(np.log(now / first[0]) / np.log(len(faces) / first[1]))
        first = first or (now, len(faces))
        rows.append(row)
        vertices, faces = igl.upsample(vertices, faces.astype(np.int64))


def sample_memory(vertices, faces):
    """Write ten million samples of the Bunny."""
    counts = {"surface": 2, "offsets": 2, "shallow": 1, "penetration": 2, "bent": 1, "core": 0}
    counts = {k: n * 1_000_000 for k, n in counts.items()} | {"box": 2_000_000}
    options = SampleOptions(**counts)
    strata = Strata(Body(vertices, faces, UNIT), options, 0)
    path = Path(tempfile.mkdtemp()) / "samples.zarr.zip"
    with ArtifactWriter(path, "samples") as writer:
        for name, column in strata.columns().items():
            writer.declare(name, **column)
        for shard in strata.shards(silent_progress):
            for name, rows in shard.items():
                writer.append(name, rows)
        writer.finish(strata.attributes(), {})


def grid_memory(vertices, faces):
    """Write the 512³ distance grid of the Bunny."""
    grid = DenseGrid(
        MeshDistance(vertices, faces), "distance", 512, band=BAND, progress=silent_progress
    )
    path = Path(tempfile.mkdtemp()) / "grid.zarr.zip"
    with ArtifactWriter(path, "grid") as writer:
        writer.declare("values", **grid.column(32))
        for slab in grid.slabs(32):
            writer.append("values", slab)
        writer.finish(grid.attributes(), {})


MEMORY = {"10 M samples": sample_memory, "512³ distance grid": grid_memory}


def main():
    """Measure everything."""
    rows = []
    vertices, faces = load(SCANS["bunny"])
    for order in ("in no order", "along the surface"):
        labels(vertices, faces, rows, order)
    one_query(vertices, faces, rows)
    grids(vertices, faces, rows)
    # a repair needs more memory than what is measured here: hand over its result
    mesh = Path(tempfile.mkdtemp()) / "mesh.npz"
    np.savez(mesh, vertices=vertices, faces=faces)
    for case in MEMORY:
        start = time.perf_counter()
        command = [sys.executable, __file__, case, str(mesh)]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        rows.append({"what": "memory", "case": case, "unit": "MiB"} | json.loads(done.stdout))
        seconds = time.perf_counter() - start
        rows.append({"what": "time", "case": case, "value": seconds, "unit": "s"})
    for row in rows:
        print(row, file=sys.stderr)
    write("distances", COLUMNS, rows)


if __name__ == "__main__":
    if sys.argv[1:]:
        MEMORY[sys.argv[1]](**np.load(sys.argv[2]))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps({"value": peak}))
    else:
        main()

"""Labels per second on a GPU, near a mesh and in its box; write a table.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/labels.py prepare FILE.npz [MESH]
       .venv/bin/python tests/benchmarks/labels.py FILE.npz TABLE [POINTS]

`prepare` repairs a scan and keeps it, so that the machine with the GPU needs neither the scans nor
the mesh libraries, but Warp, pydantic and a C compiler. Points are normally distributed around the
surface (0.01 of the unit frame), and uniform in the box, in no order. Times are medians of five,
without and with the transfers to and from the device. The host labels a tenth of the points again:
signs that differ, and the largest difference of a distance.
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np
from common import SCANS, load, notes

from pandis.pipeline.geometry.sampling import Surface

COLUMNS = ("points", "faces", "per_s", "with_transfers_per_s", "compared", "signs", "off")
TIMES, AROUND, COMPARED = 5, 0.01, 10


def prepare(path, mesh="bunny"):
    """Keep a repaired scan in the unit frame."""
    vertices, faces = load(SCANS[mesh])
    np.savez(path, vertices=vertices, faces=faces)


def places(vertices, faces, count, rng):
    """Yield the name of each set of points, and the points."""
    feet = rng.permutation(Surface(vertices, faces).draw(count, rng)[0])
    yield "near the surface", feet + rng.normal(0, AROUND, feet.shape)
    yield "in the box", rng.uniform(-1, 1, (count, 3))


def per_second(run, count):
    """Return how often a second a call does what it does so many times; the first call compiles."""
    run()
    taken = []
    for _ in range(TIMES):
        start = time.perf_counter()
        run()
        taken.append(time.perf_counter() - start)
    return count / float(np.median(taken))


def main(path, table, count=10_000_000):
    """Measure, and write the table."""
    import warp

    from pandis.engine.bvh import Bvh
    from pandis.engine.cuda.meshes import MeshLabels

    with np.load(path) as arrays:
        vertices, faces = arrays["vertices"], arrays["faces"]
    tree, rows = Bvh(vertices, faces), []
    labels = MeshLabels(tree.parts(), tree.reach, "cuda")
    for name, points in places(vertices, faces, count, np.random.default_rng(0)):
        queries = labels.upload(points)

        def launch(queries=queries):
            labels.launch(queries, 1e-9)
            warp.synchronize()

        speeds = [per_second(launch, count)]
        speeds.append(per_second(lambda points=points: labels.label(points, 1e-9), count))
        seen = labels.label(points, 1e-9)[0][::COMPARED]
        exact = tree.label(points[::COMPARED], 1e-9).distance
        signs = int((np.signbit(seen) != np.signbit(exact)).sum())
        off = float(np.abs(seen - exact).max())
        cells = name, len(faces), *speeds, len(seen), signs, off
        rows.append(dict(zip(COLUMNS, cells, strict=True)))
        print(rows[-1], file=sys.stderr, flush=True)
    with Path(table).open("w", encoding="utf-8", newline="") as stream:
        stream.write(notes("labels.py FILE.npz TABLE", warp.get_device("cuda").name))
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})


if __name__ == "__main__":
    if sys.argv[1] == "prepare":
        prepare(Path(sys.argv[2]), *sys.argv[3:])
    else:
        main(Path(sys.argv[1]), sys.argv[2], *map(int, sys.argv[3:]))

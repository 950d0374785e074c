"""Points per second of fields in Warp, and how far they are from pandis.h; prints a table.

Usage: .venv/bin/python tests/benchmarks/kernels.py DEVICE POINTS FILE.pandis...

DEVICE is `cpu` or `cuda`. Two kinds of points in the box of the unit frame: uniform ones, and those
that a press may reach (at most 0.02 from the surface). Medians of seven turns, arrays at hand.
`distance` and `gradient`: the largest differences from pandis.h, unit frame, at 100,000 points of
each kind, of answers that pandis.h did not cut.
"""

import sys
import time

import common  # noqa: F401 - makes pandis importable
import numpy as np
import warp as wp

from pandis.bridges.warp import WarpField
from pandis.runtime.field import NativeField

TURNS, COMPARED, NEAR = 7, 100_000, 0.02
COLUMNS = "field,points,device,mega_points_per_s,distance,gradient,pandis_h_mega_points_per_s"


def sets(field, count):
    """Return points (count, 3) in mesh units by what they are called."""
    rng = np.random.default_rng(1)
    uniform = rng.uniform(-0.95, 0.95, (count, 3))
    some = rng.uniform(-0.95, 0.95, (min(count, 200_000), 3))
    answer = field.query(field.frame.to_mesh(some))
    distance, normal = answer.distance * field.frame.scale, answer.normal
    feet = (some - distance[:, None] * normal)[np.isfinite(distance)]
    near = feet[rng.integers(0, len(feet), count)]
    near = near + rng.uniform(-NEAR, NEAR, (count, 3)) / np.sqrt(3)
    return {"uniform": field.frame.to_mesh(uniform), "near": field.frame.to_mesh(near)}


def measure(path, device, count):
    """Yield a row of each kind of points."""
    native, field = NativeField(path), WarpField(path, device)
    for name, points in sets(native, count).items():
        there = wp.array(points, dtype=wp.vec3d, device=device)
        answers = [out.numpy()[:COMPARED] for out in field.query(there)]  # compiles, too
        taken = []
        for _ in range(TURNS):
            wp.synchronize_device(device)
            start = time.perf_counter()
            field.query(there)
            wp.synchronize_device(device)
            taken.append(time.perf_counter() - start)
        start = time.perf_counter()
        wanted, slopes = native.query_slopes(points[:COMPARED])
        here = min(count, COMPARED) / (time.perf_counter() - start)
        whole = wanted.flag < 2
        distance = np.abs(answers[0] - wanted.distance)[whole] * native.frame.scale
        normal = np.linalg.norm(answers[1] - wanted.normal, axis=1)[whole] * slopes[whole]
        rate = count / np.median(taken)
        yield (
            f"{native.path.stem},{name},{wp.get_device(device).name},{rate / 1e6:.4g},"
            f"{distance.max():.2g},{normal.max():.2g},{here / 1e6:.4g}"
        )


def main():
    device, count, *files = sys.argv[1:]
    wp.config.quiet = True
    print(COLUMNS)
    for path in files:
        for row in measure(path, device, int(float(count))):
            print(row, flush=True)


if __name__ == "__main__":
    main()

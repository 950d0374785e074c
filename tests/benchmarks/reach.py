"""Queries with a reach against full ones; prints medians in microseconds.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/reach.py

Of three scans, as `exact` and as `compact-16`: a full query along a path with steps of 0.004 and of
0.009 of the unit frame (0.5 m/s for an object of 10 cm), and at uniform points of the box, there
also with a reach of 0.05. All take turns in one run. The last figure is what any hint could save
that tells how far the surface is: a query that is given the distance to a millionth, over one that
is not, point by point, in the median.
"""

import numpy as np
from common import SCANS, load

from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import pack_body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

TURNS, QUERIES, REACH = 5, 8000, 0.05
REPEATS, PLACES = 60, 400


def path_of(body, step):
    """Return the points of a path with such steps."""
    options = TrajectoryOptions(samples=4000, step=step)
    return trace(body, options, 1, progress=silent_progress)[0]["points"]


def with_the_distance(field, points):
    """Return the time of queries that know the distance beforehand, over that of others."""
    ratios = []
    for point, distance in zip(points, np.abs(field.query(points).distance), strict=True):
        known = distance * (1 + 1e-6) + 1e-9
        times = [field.time(point[None], REPEATS, reach=reach) for reach in (None, known)]
        ratios.append(np.median(times[1]) / np.median(times[0]))
    return np.median(ratios)


def main():
    """Measure all scans."""
    for mesh, source in SCANS.items():
        body = Body(*load(source), UNIT)
        path, fast = path_of(body, 0.004), path_of(body, 0.009)
        box = np.random.default_rng(2).uniform(-1, 1, (4000, 3))
        exact = NativeField(native_bytes(ExactField("exact", body), {}))
        packed = NativeField(pack(UNIT, file_parts(*pack_body(body, 16)), {}, version=3))
        cases = {
            "path": (path, {}),
            "fast path": (fast, {}),
            "box": (box, {}),
            "box, reach": (box, {"reach": REACH}),
        }
        for name, field in (("exact", exact), ("compact-16", packed)):
            taken = {case: [] for case in cases}
            for _ in range(TURNS):
                for case, (points, how) in cases.items():
                    taken[case].append(np.median(field.time(points, QUERIES, **how)) * 1e6)
            told = ", ".join(f"{case} {np.median(times):.3g}" for case, times in taken.items())
            ratio = with_the_distance(field, fast[:: len(fast) // PLACES])
            print(f"{mesh}, {name}: {told}, distance known {ratio:.2f}", flush=True)


if __name__ == "__main__":
    main()

"""Scenes of many objects with a proxy for each, beside penalty forces; docs/figures/touched.csv.

Usage: .venv/bin/python tests/benchmarks/touched.py [TICKS]

The scenes of `scenes.py` with 200 objects, of the exact bunny, its spline and both, a quarter of
the objects with friction; the probe goes through at 0.5 m/s, through objects, too, so that proxies
are led around them. Both kinds of scene are timed in turns, tick by tick. Then the proxies' forces
of TICKS ticks (a million by default) in each scene are compared with those of stepping every
contact at every tick, to the last bit.
"""

import sys

import numpy as np
from common import write
from scenes import HALF, TICKS, TURNS, native_fields, place, walk

from pandis.runtime.contact import Material, TouchedScene
from pandis.runtime.scene import NativeScene

COUNT, PIECE = 200, 50_000
COLUMNS = (
    *("field", "objects", "touching", "queries", "median_us", "mean_us", "p999_us"),
    *("penalty_median_us", "penalty_mean_us", "penalty_p999_us", "ticks", "different"),
)


def scenes_of(fields):
    """Return the two scenes of copies of some fields: with penalty forces, and with proxies."""
    rough = Material(0.6, 0.4, 0.5, 0.2)
    placed = [place(fields[k % len(fields)], np.random.default_rng([2, k])) for k in range(COUNT)]
    return NativeScene(placed), TouchedScene(placed, 0.0, [rough, None, None, None] * (COUNT // 4))


def timed(penalty, touched):
    """Return the seconds of ticks with penalty forces and with proxies, and what was touched."""
    path, seconds = walk(TICKS, np.random.default_rng(3), HALF), ([], [])
    for _ in range(TURNS):
        touched.restart()
        seconds[0].append(penalty.answer(path, timed=True).seconds)
        answer = touched.follow(path, timed=True)
        seconds[1].append(answer.seconds)
    return *map(np.concatenate, seconds), answer


def compared(touched, ticks):
    """Return how many forces of so many ticks are not those of stepping every contact."""
    different = 0
    for start in range(0, ticks, PIECE):
        path = walk(min(PIECE, ticks - start), np.random.default_rng([5, start]), HALF)
        every = touched.step_all(path)  # begins the scene's contacts anew
        force = touched.follow(path).force
        different += int((force.view(np.uint64) != every.view(np.uint64)).any(axis=1).sum())
    return different


def main(ticks):
    """Measure, and write the table."""
    fields, rows = dict(native_fields()), []
    for name, used in {**{n: [f] for n, f in fields.items()}, "both": [*fields.values()]}.items():
        penalty, touched = scenes_of(used)
        without, with_it, answer = timed(penalty, touched)
        row = {"field": name, "objects": COUNT, "ticks": ticks}
        row["touching"] = float((answer.touched > 0).mean())
        row["queries"] = float(answer.queries.mean())
        for key, found in (("", with_it), ("penalty_", without)):
            row[f"{key}median_us"] = float(np.median(found)) * 1e6
            row[f"{key}mean_us"] = float(np.mean(found)) * 1e6
            row[f"{key}p999_us"] = float(np.percentile(found, 99.9)) * 1e6
        row["different"] = compared(touched, ticks)
        print(row, file=sys.stderr, flush=True)
        rows.append(row)
    write("touched", COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)

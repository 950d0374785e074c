"""A minute at 1 kHz per field; write docs/figures/servo.csv.

Usage: .venv/bin/python tests/benchmarks/servo.py [SECONDS]

After `make all`: the fields that it has exported of the Bunny, along its trajectory, in the servo
loop of `pandis.runtime.servo`, and the same clock without any work. Nothing else should run. Then
each for a sixth of the time beside a busy loop on every core.
"""

import sys

import numpy as np
from common import ROOT, write

from pandis.base.frame import Frame
from pandis.pipeline.judge.servo.load import busy_cores
from pandis.pipeline.run.ask.options import HardwareOptions
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.runtime.field import NativeField
from pandis.runtime.servo import run_ticks

HOME = ROOT / "results" / "bunny"
RATE, DEADLINE = 1000.0, HardwareOptions().deadline
COLUMNS = (
    "field", "load", "ticks", "compute_p50_us", "compute_p999_us", "compute_max_us", "missed",
    "late_p999_us", "late_max_us", "late",
)  # fmt: skip


def row(name, load, run):
    """Return what a run came to, times in microseconds, shares of the ticks."""
    return {
        "field": name,
        "load": load,
        "ticks": len(run.compute),
        "compute_p50_us": 1e6 * np.median(run.compute),
        "compute_p999_us": 1e6 * np.percentile(run.compute, 99.9),
        "compute_max_us": 1e6 * run.compute.max(),
        "missed": (run.compute > DEADLINE).mean(),
        "late_p999_us": 1e6 * np.percentile(run.lateness, 99.9),
        "late_max_us": 1e6 * run.lateness.max(),
        "late": (run.lateness > DEADLINE).mean(),
    }


def main(seconds=60.0):
    """Measure, and write the table."""
    trajectory = read_artifact(HOME / "trajectory.zarr.zip", "trajectory")
    frame = Frame.of(trajectory)
    points = frame.to_mesh(trajectory.arrays["points"])
    fields = {path.stem: NativeField(path) for path in sorted((HOME / "export").glob("*.pandis"))}
    rows, ticks = [], round(seconds * RATE)
    for name, field in ({"clock alone": None} | fields).items():
        rows.append(row(name, "none", run_ticks(field, points, ticks, rate=RATE)))
        with busy_cores():
            rows.append(row(name, "every core", run_ticks(field, points, ticks // 6, rate=RATE)))
        print(*(f"{k} {v}" for k, v in rows[-2].items()), file=sys.stderr, flush=True)
    write("servo", COLUMNS, rows)


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))

"""What a contact costs and holds, on every kind of field; writes docs/figures/contact.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/contact.py [TICKS]

The bunny, 10 cm long, at a tick per millisecond. `slide`: a probe follows a trajectory 1.7 mm below
the surface at 0.11 and at 0.5 m/s: queries and microseconds of the ticks that touch. `random`: a
smooth way through the whole box at 0.36 m/s in the median, TICKS in all (10 million by default): no
force may be no number, none may change by more than its bound, and no proxy lie deeper (exact
distance, every tenth tick) than the field's largest error at the surface and 0.05 mm.
"""

import sys

import numpy as np
from bodies import UNIT, field_of
from common import SCANS, load, write
from presses import SIZE, places_on

from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.judge.servo.passes import MARGIN
from pandis.pipeline.run.ask.options import TrajectoryOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.contact import TOUCHING, NativeContact
from pandis.runtime.scene import Placed

KINDS = (
    *("exact", "compact-16", "spline-800K", "tricubic-96"),
    *("trilinear-normal-96", "trilinear-gradient-96"),
)
STEPS, DEPTH, PART, EVERY, STIFF = (0.002, 0.009), 0.03, 100_000, 10, 400.0
METRES = SIZE / UNIT_SIDE
COLUMNS = (
    *("field", "motion", "ticks", "touching", "queries", "queries_p99.9", "us", "us_p99.9"),
    *("behind", "steepest_n_per_ms", "over_bound", "no_number", "error_mm", "deepest_mm", "passes"),
)


def slides(body, step):
    """Return the path (n, 3) of a probe that goes along a trajectory below the surface, m."""
    options = TrajectoryOptions(samples=4000, step=step)
    seen = trace(body, options, 1, progress=silent_progress)[0]
    points, normals = seen["points"], seen["normal"]
    above = points - seen["distance"][:, None] * normals
    down = np.linspace(0.05, -DEPTH, 60)[:, None]
    return np.concatenate([above[0] + down * normals[0], above - DEPTH * normals]) * METRES


def wander(rng, count):
    """Return a smooth path (count, 3) through the box that begins outside, m."""
    turns = 0.004 * np.arange(count)[:, None]
    path = sum(rng.normal(size=3) * np.sin(rng.uniform(0.3, 3, 3) * turns + rng.uniform(0, 7, 3))
               for _ in range(8))  # fmt: skip
    path *= 0.28
    path[0] = 5.0
    return path * METRES


def followed(field, body, path, error):
    """Return the columns of one path."""
    contact = NativeContact(Placed.at(field, SIZE, STIFF))
    touches = contact.follow(path, timed=True)
    held = (touches.state & TOUCHING) > 0
    changed = np.linalg.norm(np.diff(touches.force, axis=0), axis=1)
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    bound = STIFF * (2 * moved + contact.options.slide * 1e-3)
    places = touches.proxy[::EVERY] / METRES
    deep = -body.distance.distance_and_normal(places, check=False)[0] * METRES
    us = 1e6 * touches.seconds[held]
    return {
        "ticks": len(path), "touching": held.mean(), "queries": np.median(touches.queries[held]),
        "queries_p99.9": np.percentile(touches.queries, 99.9), "us": np.median(us),
        "us_p99.9": np.percentile(us, 99.9), "behind": ((touches.state & 4) > 0).mean(),
        "steepest_n_per_ms": changed.max(), "over_bound": int((changed > bound + 1e-9).sum()),
        "no_number": int((~np.isfinite(touches.force)).sum()), "deepest_mm": 1e3 * deep.max(),
        "passes": int((deep > error + MARGIN).sum()),
    }  # fmt: skip


def together(parts):
    """Return the columns of several paths as one."""
    joined = {name: float(np.mean([part[name] for part in parts])) for name in parts[0]}
    for name in ("ticks", "over_bound", "no_number", "passes"):
        joined[name] = sum(part[name] for part in parts)
    for name in ("steepest_n_per_ms", "deepest_mm"):
        joined[name] = max(part[name] for part in parts)
    return joined


def main(ticks):
    """Follow all paths with all kinds of field."""
    body = Body(*load(SCANS["bunny"]), UNIT)
    everywhere = lambda c: np.ones(len(c), bool)  # noqa: E731
    on_it = places_on(body.distance.vertices, body.distance.faces, everywhere, 100_000,
                      np.random.default_rng(0))[0]  # fmt: skip
    slid, rows = {step: slides(body, step) for step in STEPS}, []
    for kind in KINDS:
        field = field_of(body, kind)
        error = float(np.abs(field.query(on_it).distance).max()) * METRES
        row = {"field": kind, "error_mm": 1e3 * error}
        for step, path in slid.items():
            followed(field, body, path, error)  # fills the caches
            speed = f"slide, {step * METRES * 1e3:.2g} m/s"
            rows.append(row | {"motion": speed} | followed(field, body, path, error))
        rng = np.random.default_rng(1)
        parts = [followed(field, body, wander(rng, PART), error)
                 for _ in range(max(1, ticks // len(KINDS) // PART))]  # fmt: skip
        rows.append(row | {"motion": "random"} | together(parts))
        print(*rows[-3:], sep="\n", flush=True)
    write("contact", COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)

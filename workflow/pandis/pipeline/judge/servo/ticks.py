"""Runs an exported field at the servo rate, and judges its times and forces."""

import numpy as np

from pandis.pipeline.judge.servo.load import busy_cores
from pandis.pipeline.judge.servo.verdict import machine_verdict
from pandis.pipeline.judge.servo.walls import faults
from pandis.pipeline.run.records.hardware import ServoVerdict, Ticks
from pandis.runtime.servo import run_ticks

#: Largest permitted difference from the evaluated forces (unit frame, k = 1).
AGREEMENT = 2e-5
_LEVELS = {"p50": 50, "p99": 99, "p99.9": 99.9, "max": 100}


def validate(field, frame, points, *, reference, walls, options):
    """Run one exported field at the servo rate and judge it.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    frame : pandis.base.frame.Frame
    points : ndarray, shape (m, 3), mesh units
        The evaluation trajectory.
    reference : ndarray, shape (m, 3)
        The evaluated force of the same file at ``points`` (unit frame, k = 1). The export stage has
        already compared the file with the library.
    walls : pandis.pipeline.run.records.hardware.WallVerdict
    options : pandis.pipeline.run.ask.options.HardwareOptions

    Returns
    -------
    arrays : dict of str to ndarray
        Per tick: ``compute`` and ``lateness`` (s), ``force`` (unit frame, k = 1).
    servo : pandis.pipeline.run.records.hardware.ServoVerdict
    """
    run = run_ticks(field, points, tick_count(options), rate=options.rate, again=options.ask_again)
    force = run.force * frame.scale  # distances are in mesh units
    expected = reference[np.arange(len(force)) % len(points)]
    difference = np.linalg.norm(force - expected, axis=1).max()
    missed = run.compute > options.deadline
    share, late = float(missed.mean()), late_share(run.lateness, options)
    agrees = bool(difference <= AGREEMENT)
    in_time, punctual = bool(share <= options.misses), bool(late <= options.misses)
    servo = ServoVerdict(
        ticks=len(force),
        compute_us=microseconds(run.compute),
        lateness_us=microseconds(run.lateness),
        late_share=late,
        misses=int(missed.sum()),
        miss_share=share,
        longest_run_of_misses=_longest_run(missed),
        agreement=float(difference),
        agrees=agrees,
        in_time=in_time,
        punctual=punctual,
        walls=walls,
    )
    servo = servo.model_copy(update={"verdict": machine_verdict(servo)})
    words = {"sentence": _sentence(servo, options)}
    if options.loaded_seconds:
        words["loaded"] = _loaded(field, points, options)
    arrays = {"compute": run.compute, "lateness": run.lateness, "force": force}
    return arrays, servo.model_copy(update=words)


def _loaded(field, points, options):
    """Run a field while other work loads every core."""
    count = max(1, round(options.loaded_seconds * options.rate))
    with busy_cores():
        run = run_ticks(field, points, count, rate=options.rate, again=options.ask_again)
    return Ticks(
        ticks=count,
        compute_us=microseconds(run.compute),
        lateness_us=microseconds(run.lateness),
        late_share=late_share(run.lateness, options),
        miss_share=float((run.compute > options.deadline).mean()),
    )


def tick_count(options):
    """Return the number of ticks of a run."""
    return max(1, round(options.seconds * options.rate))


def late_share(lateness, options):
    """Return the share of ticks that begin late by more than the deadline."""
    return float((lateness > options.deadline).mean())


def microseconds(seconds):
    """Return percentiles of times, µs."""
    values = np.percentile(seconds, list(_LEVELS.values())) * 1e6
    return dict(zip(_LEVELS, values.tolist(), strict=True))


def _longest_run(missed):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missed.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _sentence(servo, options):
    """Return a sentence with the verdict and its figures."""
    rate, deadline = options.rate, options.deadline * 1e3
    allowed = f"{100 * options.misses:g} % allowed"
    time = (
        f"{100 * servo.miss_share:.2f} % of the ticks took longer than {deadline:g} ms to compute "
        f"at {rate:g} Hz, {100 * servo.late_share:.2f} % began more than that late ({allowed})"
    )
    force = f"forces equal the evaluated ones within {servo.agreement:.1e}"
    if not servo.agrees:
        off = servo.agreement
        force = f"forces differ from the evaluated ones by {off:.1e} ({AGREEMENT:.0e} allowed)"
    walls = servo.walls
    compared = "; ".join(faults(walls)) or (
        f"{walls.missing:.2%} of the surface lacks the force, and {walls.strongly_felt:.2%} pushes "
        "with a strongly different one"
    )
    if walls.pressed_missing:
        at = walls.pressed_missing
        compared += f"; the force is missing at {at} of the points that a device presses on"
    return f"{servo.verdict.capitalize()}: {time}; {force}; {compared}."

"""The verdict on every exported field."""

import json

import numpy as np

from pandis.export.session import Session
from pandis.forces import penalty_force
from pandis.frame import Frame
from pandis.hardware.clock import run_ticks
from pandis.machine import describe

#: Largest difference from the library's own force that passes (unit frame, k = 1).
AGREEMENT = 2e-5

NO_DEVICE = (
    "No haptic device was attached: the exported files were run by ONNX Runtime from a Python "
    "loop at the servo rate, along the evaluation trajectory, on the machine named here."
)


def validate_exports(exports, trajectory, evaluation, mesh, options, progress):
    """Validate all exported fields of a mesh, one after the other.

    Parameters
    ----------
    exports : list of Path
        ``{field}.onnx``.
    trajectory, evaluation : pandis.artifact.Artifact
    mesh : str
        Its name.
    options : dict
        See `pandis.config.HardwareOptions`.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``hardware.zarr.zip``.
    text : str
        ``hardware.json``.
    """
    frame = Frame.from_attributes(trajectory.attributes["frame"])
    points = frame.to_mesh(trajectory.arrays["points"])
    arrays, fields = {}, {}
    report = progress("fields", len(exports), "fields")
    for index, path in enumerate(exports):
        name = path.stem
        reference = evaluation.arrays[f"force_{name}"]
        ticks, fields[name] = validate(Session(path), frame, points, reference, options)
        arrays |= {f"{key}_{name}": values for key, values in ticks.items()}
        report.update(index + 1)
    attributes = {
        "statement": NO_DEVICE,
        "device": None,
        "machine": describe(),
        "rate": options["rate"],
        "deadline": options["deadline"],
        "newtons": frame.newtons(options["size"], options["stiffness"]),
        "fields": fields,
        "reproducible": False,
    }
    return arrays, attributes, json.dumps({"mesh": mesh} | attributes, indent=2) + "\n"


def validate(session, frame, points, reference, options):
    """Run one exported field at the servo rate and judge it.

    Parameters
    ----------
    session : pandis.export.session.Session
    frame : pandis.frame.Frame
    points : ndarray, shape (m, 3), mesh units
        The evaluation trajectory.
    reference : ndarray, shape (m, 3)
        The library's force of this field there (unit frame, k = 1).
    options : dict
        See `pandis.config.HardwareOptions`.

    Returns
    -------
    arrays, verdict : dict
        Per tick: ``compute`` and ``lateness`` (s), ``force`` (unit frame, k = 1).
    """

    # as a servo loop would have it: position in, force out
    def servo(point):
        return penalty_force(*session.distance_and_normal(point))

    count = max(1, round(options["seconds"] * options["rate"]))
    compute, lateness, force = run_ticks(servo, points, count, options["rate"])
    force *= frame.scale  # distances came in mesh units
    difference = np.linalg.norm(force - reference[np.arange(count) % len(points)], axis=1).max()
    missed = compute > options["deadline"]
    share = float(missed.mean())
    agrees, in_time = bool(difference <= AGREEMENT), bool(share <= options["misses"])
    names = ("p50", "p99", "p99.9", "max")
    levels = (50, 99, 99.9, 100)
    verdict = {
        "ticks": count,
        "compute_us": dict(zip(names, _microseconds(compute, levels), strict=True)),
        "lateness_us": dict(zip(names, _microseconds(lateness, levels), strict=True)),
        "misses": int(missed.sum()),
        "miss_share": share,
        "longest_run_of_misses": _longest_run(missed),
        "agreement": float(difference),
        "agrees": agrees,
        "in_time": in_time,
        "verdict": "pass" if agrees and in_time else "fail",
        "sentence": _sentence(share, difference, agrees, in_time, options),
    }
    return {"compute": compute, "lateness": lateness, "force": force}, verdict


def _microseconds(seconds, levels):
    return [float(v) for v in np.percentile(seconds, levels) * 1e6]


def _longest_run(missed):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missed.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _sentence(share, difference, agrees, in_time, options):
    rate, deadline = options["rate"], options["deadline"] * 1e3
    time = (
        f"{100 * share:.2f} % of the ticks computed longer than {deadline:g} ms at {rate:g} Hz "
        f"({100 * options['misses']:g} % allowed)"
    )
    force = f"forces agree with the library's within {difference:.1e}"
    if not agrees:
        force = f"forces differ from the library's by {difference:.1e} ({AGREEMENT:.0e} allowed)"
    return f"{'Pass' if agrees and in_time else 'Fail'}: {time}; {force}."

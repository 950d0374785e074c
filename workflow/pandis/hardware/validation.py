"""The verdict on every exported field."""

import hashlib
import json

import numpy as np

from pandis.geometry.frame import Frame
from pandis.geometry.measure import MISSING_LIMIT
from pandis.hardware.attached import run_attached
from pandis.hardware.devices import DEVICES
from pandis.hardware.load import busy_cores
from pandis.hardware.pressing import Hand, contact, press
from pandis.hardware.verdict import device_sentence, judge, machine_verdict, paragraph
from pandis.hardware.walls import compare
from pandis.native.runtime import NativeField
from pandis.native.servo import run_ticks
from pandis.run.machine import describe, governor

#: Largest difference from the forces that were evaluated that passes (unit frame, k = 1).
AGREEMENT = 2e-5
#: A tick has so much of its period, whatever the deadline.
WITHIN = 0.8
_LEVELS = {"p50": 50, "p99": 99, "p99.9": 99.9, "max": 100}

NO_ATTACHED = "No haptic device was attached."
WHAT_RAN = (
    "The exported files were asked by pandis.h in a C loop at the servo rate, along the evaluation "
    "trajectory, on the machine named here; their forces were compared with the exact ones below "
    "surface points of every thickness. Devices that are named are simulated."
)

#: What the loop does while it waits.
AGAIN = (
    "While it waited for a tick the loop asked the field once more where the probe was last, so "
    "that its bytes were still in the caches (hardware.ask_again): a device's own scheduler cannot."
)
ONCE = "Between two ticks the loop asked nothing (hardware.ask_again is false)."


def validate_exports(exports, walls, trajectory, evaluation, mesh, options, progress):
    """Validate all exported fields of a mesh, one after the other.

    Parameters
    ----------
    exports : list of Path
        ``{field}.pandis``.
    walls : pandis.hardware.walls.Walls
        Where forces are compared with the exact ones, and where devices press.
    trajectory, evaluation : pandis.run.artifact.Artifact
    mesh : str
        Its name.
    options : dict
        See `pandis.run.options.HardwareOptions`.
    progress : callable
        Makes a `pandis.run.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``hardware.zarr.zip``: per field and tick compute time, lateness and force;
        the same clock without work, and the fields beside other work on every core.
    text : str
        ``hardware.json``.
    """
    frame = Frame.from_attributes(trajectory.attributes["frame"])
    points = frame.to_mesh(trajectory.arrays["points"])
    options = options | {"deadline": min(options["deadline"], WITHIN / options["rate"])}
    arrays, fields = {}, {}
    surface = contact(trajectory.arrays, walls.pressed, options["size"])
    report = progress("fields", len(exports), "fields")
    idle = run_ticks(None, points, _ticks(options), options["rate"])
    asked = AGAIN if options["ask_again"] else ONCE
    arrays["lateness"] = idle.lateness
    for index, path in enumerate(exports):
        name = path.stem
        reference = evaluation.arrays[f"force_{name}"]
        field = NativeField(path)
        found = compare(unit_force(field, frame), walls)
        ticks, verdict = validate(field, frame, points, reference, found, options)
        verdict["devices"] = press_devices(field, surface, found, options)
        verdict["advice"] = paragraph(verdict, verdict["devices"], options)
        verdict["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
        if options["attached"]:
            own, verdict["attached"] = _attached(field, surface, found, verdict, options)
            ticks |= {f"device_{key}": values for key, values in own.items()}
        arrays |= {f"{key}_{name}": values for key, values in ticks.items()}
        fields[name] = verdict
        report.update(index + 1)
    attributes = {
        "statement": f"{_statement(fields)} {asked}",
        "devices": {name: DEVICES[name]._asdict() for name in options["devices"]},
        "machine": describe() | {"governor": governor()},
        "locked": idle.locked,
        "realtime": idle.realtime,
        "rate": options["rate"],
        "deadline": options["deadline"],
        "size": options["size"],
        "newtons": frame.newtons(options["size"], options["stiffness"]),
        "clock_alone_us": _microseconds(idle.lateness),
        "clock_alone_late_share": _late(idle.lateness, options),
        "fields": fields,
        "reproducible": False,
    }
    return arrays, attributes, json.dumps({"mesh": mesh} | attributes, indent=2) + "\n"


def _attached(field, surface, walls, verdict, options):
    """Run a field on the attached device, with no more than is safe on a simulated one."""
    own = options | options["attached"]
    rate = DEVICES[own["model"]].rate
    pressed = verdict["devices"].get(own["model"])
    if pressed is None or options["rate"] != rate:  # what is safe at one rate is not at another
        chosen = options | {"devices": [own["model"]], "rate": rate}
        pressed = press_devices(field, surface, walls, chosen)[own["model"]]
    sound = verdict["agrees"] and verdict["in_time"]
    return run_attached(field, options["size"], options["stiffness"], own, pressed, walls, sound)


def _statement(fields):
    """Say what ran: that a device did only where one has."""
    said = [v["attached"]["statement"] for v in fields.values() if "attached" in v]
    return " ".join([WHAT_RAN, *dict.fromkeys(said)]) if said else f"{NO_ATTACHED} {WHAT_RAN}"


def unit_force(field, frame):
    """Return what answers an exported field's force (n, 3) in the unit frame, at k = 1."""
    return lambda points: field.force(frame.to_mesh(points)) * frame.scale


def press_devices(field, surface, walls, options):
    """Press every simulated device that is asked for onto a field's object.

    ``walls`` is what `pandis.hardware.walls.compare` found.

    Returns
    -------
    dict of str to dict
        By the device's name: what `pandis.hardware.pressing.press` found, ``verdict`` and
        ``sentence``.
    """
    hand, stiffness = Hand(**options["hand"]), options["stiffness"]
    found = {}
    for name in options["devices"]:
        own = press(
            field, DEVICES[name], surface, options["size"], stiffness, hand, options["rate"]
        )
        own |= {"device": name, "pressed_missing": walls["pressed_missing"]}
        own["holds"] = walls["holds"]
        own["verdict"], own["sentence"] = judge(own), device_sentence(own)
        found[name] = own
    return found


def validate(field, frame, points, reference, walls, options):
    """Run one exported field at the servo rate and judge it.

    Parameters
    ----------
    field : pandis.native.runtime.NativeField
    frame : pandis.geometry.frame.Frame
    points : ndarray, shape (m, 3), mesh units
        The evaluation trajectory.
    reference : ndarray, shape (m, 3)
        The force that was evaluated there, of the same file (unit frame, k = 1); export has
        compared that file with the library.
    walls : dict
        From `pandis.hardware.walls.compare`.
    options : dict
        See `pandis.run.options.HardwareOptions`.

    Returns
    -------
    arrays, verdict : dict
        Per tick: ``compute`` and ``lateness`` (s), ``force`` (unit frame, k = 1).
    """
    run = run_ticks(field, points, _ticks(options), options["rate"], options["ask_again"])
    force = run.force * frame.scale  # distances came in mesh units
    wanted = reference[np.arange(len(force)) % len(points)]
    difference = np.linalg.norm(force - wanted, axis=1).max()
    missed = run.compute > options["deadline"]
    share, late = float(missed.mean()), _late(run.lateness, options)
    agrees = bool(difference <= AGREEMENT)
    in_time, punctual = bool(share <= options["misses"]), bool(late <= options["misses"])
    verdict = {
        "ticks": len(force),
        "compute_us": _microseconds(run.compute),
        "lateness_us": _microseconds(run.lateness),
        "late_share": late,
        "misses": int(missed.sum()),
        "miss_share": share,
        "longest_run_of_misses": _longest_run(missed),
        "agreement": float(difference),
        "agrees": agrees,
        "in_time": in_time,
        "punctual": punctual,
        "walls": walls,
    }
    verdict["verdict"] = machine_verdict(verdict)
    verdict["sentence"] = _sentence(verdict, options)
    if options["loaded_seconds"]:
        verdict["loaded"] = _loaded(field, points, options)
    return {"compute": run.compute, "lateness": run.lateness, "force": force}, verdict


def _loaded(field, points, options):
    """Run a field beside other work on every core."""
    count = max(1, round(options["loaded_seconds"] * options["rate"]))
    with busy_cores():
        run = run_ticks(field, points, count, options["rate"], options["ask_again"])
    return {
        "ticks": count,
        "compute_us": _microseconds(run.compute),
        "lateness_us": _microseconds(run.lateness),
        "late_share": _late(run.lateness, options),
        "miss_share": float((run.compute > options["deadline"]).mean()),
    }


def _ticks(options):
    return max(1, round(options["seconds"] * options["rate"]))


def _late(lateness, options):
    """Return the share of ticks that begin later than the deadline."""
    return float((lateness > options["deadline"]).mean())


def _microseconds(seconds):
    values = np.percentile(seconds, list(_LEVELS.values())) * 1e6
    return dict(zip(_LEVELS, values.tolist(), strict=True))


def _longest_run(missed):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missed.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _sentence(verdict, options):
    """Say what was judged, and how it came out."""
    rate, deadline = options["rate"], options["deadline"] * 1e3
    allowed = f"{100 * options['misses']:g} % allowed"
    time = (
        f"{100 * verdict['miss_share']:.2f} % of the ticks computed longer than {deadline:g} ms at "
        f"{rate:g} Hz, {100 * verdict['late_share']:.2f} % began later than that ({allowed})"
    )
    force = f"forces are the evaluated ones within {verdict['agreement']:.1e}"
    if not verdict["agrees"]:
        off = verdict["agreement"]
        force = f"forces differ from the evaluated ones by {off:.1e} ({AGREEMENT:.0e} allowed)"
    walls = verdict["walls"]
    lacks = f"{100 * walls['missing']:.2g} % of the surface lacks the force"
    if walls["pressed_missing"]:
        lacks += f", and so do {walls['pressed_missing']} of the points that a device presses on"
    how = verdict["verdict"].capitalize()
    return f"{how}: {time}; {force}; {lacks} ({100 * MISSING_LIMIT:g} % allowed)."

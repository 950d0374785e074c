"""Validates every exported field at the servo rate and on simulated devices."""

import hashlib
import json
from typing import NamedTuple

import numpy as np

from pandis.base.forces import force_of
from pandis.base.frame import UNIT_SIDE, Frame
from pandis.base.physical import Scale
from pandis.pipeline.geometry.shares import missing
from pandis.pipeline.judge.servo.attached import Safety, Span, run_attached
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.load import busy_cores
from pandis.pipeline.judge.servo.passes import Oracle
from pandis.pipeline.judge.servo.pressing import Setup, contact, press
from pandis.pipeline.judge.servo.proxies import (
    Truth,
    feel_for,
    regions_among,
    touch_device,
    try_proxy,
)
from pandis.pipeline.judge.servo.verdict import device_sentence, judge, machine_verdict, paragraph
from pandis.pipeline.judge.servo.walls import compare, faults, open_walls
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.job.machine import describe, governor
from pandis.pipeline.run.records.hardware import (
    DeviceVerdict,
    FieldVerdict,
    HardwareRecord,
    ProxyVerdict,
    ServoVerdict,
    Ticks,
)
from pandis.runtime.contact import Feel
from pandis.runtime.contact.surfaces import unknown_materials
from pandis.runtime.field import NativeField
from pandis.runtime.servo import run_ticks

#: Largest permitted difference from the evaluated forces (unit frame, k = 1).
AGREEMENT = 2e-5
#: Largest share of its period that a tick may take, whatever the deadline.
WITHIN = 0.8
#: The probe begins _OUTSIDE above the surface (unit frame), and approaches in _WAY ticks.
_OUTSIDE, _WAY = 0.05, 50
_LEVELS = {"p50": 50, "p99": 99, "p99.9": 99.9, "max": 100}

NO_ATTACHED = "No haptic device was attached."
WHAT_RAN = (
    "pandis.h queried the exported files in a C loop at the servo rate, along the evaluation "
    "trajectory, on the machine named here. Their forces below the surface were compared with the "
    "exact ones, on parts of every thickness. The devices named here are simulated."
)

#: Statements on what the loop does between ticks.
AGAIN = (
    "While it waited for a tick, the loop queried the field again at the probe's last position, to "
    "keep its data in the caches (hardware.ask_again). A device's own scheduler cannot do this."
)
ONCE = "Between ticks the loop made no queries (hardware.ask_again is false)."


def validate_exports(exports, body, *, trajectory, evaluation, options, context):
    """Validate all exported fields of a mesh, one after the other.

    Parameters
    ----------
    exports : list of Path
        ``{field}.pandis``.
    body : pandis.pipeline.geometry.body.Body
    trajectory, evaluation : pandis.pipeline.run.job.artifact.Artifact
    options : pandis.pipeline.run.ask.tasks.ValidateTask
    context : pandis.base.progress.Context

    Returns
    -------
    arrays, attributes : dict
        As stored in ``hardware.zarr.zip``: compute time, lateness and force per field and tick;
        lateness of the clock without work; results while other work loads every core.
    """
    scale = Scale.of(options)
    walls = open_walls(ExactField("exact", body), scale, options.seed)
    oracle = Oracle(body.corners / scale.metre, body.faces)
    frame = Frame.of(trajectory)
    points = frame.to_mesh(trajectory.arrays["points"])
    most = min(options.deadline, WITHIN / options.rate)
    options = options.model_copy(update={"deadline": most})
    arrays, fields = {}, {}
    surface = contact(trajectory.arrays, walls.pressed, walls.thin, size=options.size)
    report = context.progress("fields", len(exports), "fields")
    idle = run_ticks(None, points, _ticks(options), rate=options.rate)
    mode = AGAIN if options.ask_again else ONCE
    arrays["lateness"] = idle.lateness
    path_in, beside = _entered(trajectory.arrays, options.size), regions_among(exports)
    _check_names(options.contact, beside, context.log)
    for index, path in enumerate(exports):
        name = path.stem
        reference = evaluation.arrays[f"force_{name}"]
        field = NativeField(path)
        file = ExportedField(name, field)
        lacks = compare(file, walls)
        feet = pushing_feet(file, walls) * options.size / UNIT_SIDE
        truth = Truth(oracle, feet, surface, lacks)
        ticks, servo = validate(
            field, frame, points, reference=reference, walls=lacks, options=options
        )
        devices, attached = press_devices(field, surface, lacks, options=options), None
        query = servo.compute_us["p50"] * 1e-6
        feel, surfaces, no_proxy = feel_for(
            field, beside, options.contact, size=options.size, seconds=query, deadline=most
        )
        proxy = feel and try_proxy(
            field,
            feel,
            surfaces,
            path=path_in,
            truth=truth,
            options=options,
        )
        if options.attached:
            run = _Felt(feel, proxy, truth) if feel else None
            more, attached = _attached(
                field, surface, servo, devices=devices, options=options, felt=run
            )
            ticks |= {f"device_{key}": values for key, values in more.items()}
        arrays |= {f"{key}_{name}": values for key, values in ticks.items()}
        fields[name] = FieldVerdict(
            **dict(servo),
            devices=devices,
            advice=paragraph(servo, devices, options, proxy=proxy),
            sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            proxy=proxy,
            no_proxy=no_proxy,
            attached=attached,
        )
        report.update(index + 1)
    attributes = HardwareRecord(
        statement=f"{_statement(fields)} {mode}",
        devices={name: DEVICES[name]._asdict() for name in options.devices},
        machine=describe() | {"governor": governor()},
        locked=idle.locked,
        realtime=idle.realtime,
        rate=options.rate,
        deadline=options.deadline,
        size=options.size,
        stiffness=options.stiffness,
        contact=options.contact.kind,
        newtons=scale.newtons,
        clock_alone_us=_microseconds(idle.lateness),
        clock_alone_late_share=_late(idle.lateness, options),
        fields=fields,
    ).attributes()
    return arrays, attributes


def to_json(mesh, attributes):
    """Return the text of ``hardware.json``, given the mesh's name."""
    return json.dumps({"mesh": mesh} | attributes, indent=2) + "\n"


class _Felt(NamedTuple):
    """A field felt through a proxy: probe and surface, verdict, and the reference to judge by."""

    feel: Feel
    verdict: ProxyVerdict
    truth: Truth


def _attached(field, surface, servo, *, devices, options, felt=None):
    """Run a field on the attached device, at no more than the stiffness safe on a simulated one."""
    model = options.attached.model
    rate = DEVICES[model].rate
    pressed = (felt.verdict.devices if felt else devices).get(model)
    if pressed is None or options.rate != rate:  # a safe stiffness is valid at one rate only
        chosen = options.model_copy(update={"devices": [model], "rate": rate})
        if felt:
            pressed = touch_device(model, field, felt.feel, truth=felt.truth, options=chosen)
        else:
            pressed = press_devices(field, surface, servo.walls, options=chosen)[model]
    sound = servo.agrees and servo.in_time and (felt is None or felt.verdict.in_time)
    span = Span(options.seconds, options.deadline)
    return run_attached(
        field, Scale.of(options), options.attached, span=span,
        safety=Safety(pressed, servo.walls, sound), feel=felt and felt.feel,
    )  # fmt: skip


def _entered(trajectory, size):
    """Return the trajectory (n, 3), m, preceded by an approach from above the surface."""
    points, normals = trajectory["points"], trajectory["normal"]
    start = points[0] - trajectory["distance"][0] * normals[0]
    way = np.linspace(_OUTSIDE, trajectory["distance"][0], _WAY)[:, None]
    return np.concatenate([start + way * normals[0], points]) * size / UNIT_SIDE


def _check_names(contact, beside, log):
    """Log configured materials that no face is made of."""
    known = beside.region_names if beside else ()
    for name in unknown_materials(contact, known):
        there = "its file names no materials, or neither exact nor a compact field is exported"
        if known:
            there = f"the mesh names {', '.join(known)}"
        log(f"contact.materials.{name}: no part of this mesh is made of it: {there}")


def _statement(fields):
    """Return a statement on what ran; it names a device only if one ran."""
    statements = [v.attached.statement for v in fields.values() if v.attached]
    return (
        " ".join([WHAT_RAN, *dict.fromkeys(statements)])
        if statements
        else f"{NO_ATTACHED} {WHAT_RAN}"
    )


def pushing_feet(field, walls):
    """Return the surface points (n, 3), unit frame, below which a field's force is not missing.

    The surface error is measured only there, so that a hole does not excuse a pass through it.
    """
    probes = walls.contacts.pressed
    force = force_of(field)(probes.points)
    gone = missing(force, probes.force, probes.wall, newtons=probes.scale.newtons)
    return (probes.points - probes.distance[:, None] * probes.normal)[~gone]


def press_devices(field, surface, walls, *, options):
    """Press every configured simulated device onto an object with a field's forces.

    ``walls`` is a `pandis.pipeline.run.records.hardware.WallVerdict`.

    Returns
    -------
    dict of str to pandis.pipeline.run.records.hardware.DeviceVerdict
        By the device's name.
    """
    setup, verdicts = Setup.of(options), {}
    for name in options.devices:
        pressed = press(field, DEVICES[name], surface, setup=setup)
        verdicts[name] = DeviceVerdict(
            **dict(pressed),
            device=name,
            pressed_missing=walls.pressed_missing,
            holds=walls.holds,
            verdict=judge(pressed, walls),
            sentence=device_sentence(name, pressed, walls),
        )
    return verdicts


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
    run = run_ticks(field, points, _ticks(options), rate=options.rate, again=options.ask_again)
    force = run.force * frame.scale  # distances are in mesh units
    expected = reference[np.arange(len(force)) % len(points)]
    difference = np.linalg.norm(force - expected, axis=1).max()
    missed = run.compute > options.deadline
    share, late = float(missed.mean()), _late(run.lateness, options)
    agrees = bool(difference <= AGREEMENT)
    in_time, punctual = bool(share <= options.misses), bool(late <= options.misses)
    servo = ServoVerdict(
        ticks=len(force),
        compute_us=_microseconds(run.compute),
        lateness_us=_microseconds(run.lateness),
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
        compute_us=_microseconds(run.compute),
        lateness_us=_microseconds(run.lateness),
        late_share=_late(run.lateness, options),
        miss_share=float((run.compute > options.deadline).mean()),
    )


def _ticks(options):
    return max(1, round(options.seconds * options.rate))


def _late(lateness, options):
    """Return the share of ticks that begin late by more than the deadline."""
    return float((lateness > options.deadline).mean())


def _microseconds(seconds):
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

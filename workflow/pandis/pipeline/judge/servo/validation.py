"""Validates every exported field at the servo rate and on simulated devices."""

import hashlib
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.forces import force_of
from pandis.base.frame import UNIT_SIDE, Frame
from pandis.base.physical import Scale
from pandis.engine.threads import thread_count
from pandis.pipeline.geometry.shares import missing
from pandis.pipeline.judge.servo.attached import Safety, Span, run_attached
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.passes import Oracle
from pandis.pipeline.judge.servo.pressing import Setup, contact, find_safe, press, tried_hands
from pandis.pipeline.judge.servo.proxies import (
    Truth,
    feel_for,
    regions_among,
    time_proxy,
    touch_device,
    touch_devices,
)
from pandis.pipeline.judge.servo.ticks import late_share, microseconds, tick_count, validate
from pandis.pipeline.judge.servo.verdict import device_sentence, judge, paragraph
from pandis.pipeline.judge.servo.walls import compare, open_walls
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.job.machine import describe, governor
from pandis.pipeline.run.records.hardware import (
    DeviceVerdict,
    FieldVerdict,
    HardwareRecord,
    ProxyVerdict,
    ServoVerdict,
)
from pandis.runtime.contact import Feel
from pandis.runtime.contact.surfaces import unknown_materials
from pandis.runtime.field import NativeField
from pandis.runtime.servo import run_ticks

#: Largest share of its period that a tick may take, whatever the deadline.
WITHIN = 0.8
#: The probe begins _OUTSIDE above the surface (unit frame), and approaches in _WAY ticks.
_OUTSIDE, _WAY = 0.05, 50

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
    """Validate all exported fields of a mesh; each is timed with nothing beside it.

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
    options = options.model_copy(update={"deadline": min(options.deadline, WITHIN / options.rate)})
    scale, frame, validation = (
        Scale.of(options),
        Frame.of(trajectory),
        _Validation(exports, body, options),
    )
    points, path = frame.to_mesh(trajectory.arrays["points"]), _entered(trajectory, options.size)
    surface = contact(
        trajectory.arrays, validation.walls.pressed, validation.walls.thin, size=options.size
    )
    _check_names(options.contact, validation.beside, context.log)

    def run(one):
        reference = evaluation.arrays[f"force_{one.name}"]
        return validation.run(one, frame, points, reference=reference, path=path)

    # Fields run at the servo rate one by one. What is not timed uses all cores.
    count, cores, hands = len(exports), thread_count(), tried_hands(Setup.of(options).hand)
    report = context.progress("fields", (4 + 2 * len(hands)) * count, "steps")
    judged = _counted(each(validation.judge_walls, exports, cores), report)
    fields = [
        _FieldRun(file, NativeField(file), Truth(validation.oracle, feet, surface, lacks))
        for file, (lacks, feet) in zip(exports, judged, strict=True)
    ]
    idle = run_ticks(None, points, tick_count(options), rate=options.rate)
    fields = list(_counted(map(run, fields), report, count))
    # slow fields come first: if one began last, the other cores would wait for it
    slowest = sorted(fields, key=lambda one: -one.servo.compute_us["p50"])
    presses = [(one, proxied) for one in slowest for proxied in (True, False)]
    trials = [(*item, hand) for item in presses for hand in hands]
    searched = list(_counted(each(validation.search, trials, cores), report, 2 * count))
    safe = [searched[first : first + len(hands)] for first in range(0, len(trials), len(hands))]
    items = [(*item, most) for item, most in zip(presses, safe, strict=True)]
    pressed = _counted(each(validation.press, items, cores), report, 2 * count + len(trials))
    by_field = {
        (one.name, proxied): by_device
        for (one, proxied), by_device in zip(presses, pressed, strict=True)
    }
    arrays, verdicts = {"lateness": idle.lateness}, {}
    for one in fields:
        devices, touched = (by_field[one.name, proxied] for proxied in (False, True))
        ticks, verdicts[one.name] = validation.conclude(one, devices, touched)
        arrays |= {f"{key}_{one.name}": values for key, values in ticks.items()}
    attributes = HardwareRecord(
        statement=f"{_statement(verdicts)} {AGAIN if options.ask_again else ONCE}",
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
        clock_alone_us=microseconds(idle.lateness),
        clock_alone_late_share=late_share(idle.lateness, options),
        fields=verdicts,
    ).attributes()
    return arrays, attributes


class _FieldRun(NamedTuple):
    """A field, the reference to judge it by, and its results at the servo rate."""

    path: Path
    field: NativeField
    truth: Truth
    ticks: dict | None = None
    servo: ServoVerdict | None = None
    feel: Feel | None = None
    proxy: ProxyVerdict | None = None
    no_proxy: str = ""

    @property
    def name(self):
        return self.path.stem


class _Validation:
    """The steps that every field of a mesh goes through, and the references to judge it by."""

    def __init__(self, exports, body, options):
        scale = Scale.of(options)
        self.options, self.beside = options, regions_among(exports)
        self.walls = open_walls(ExactField("exact", body), scale, options.seed)
        self.oracle = Oracle(body.corners / scale.metre, body.faces)

    def judge_walls(self, path):
        """Return the verdict on a field's walls, and surface points (n, 3), m, where it pushes."""
        file = ExportedField(path.stem, NativeField(path))
        feet = pushing_feet(file, self.walls) * self.options.size / UNIT_SIDE
        return compare(file, self.walls), feet

    def run(self, one, frame, points, *, reference, path):
        """Time a field at the servo rate, with and without a proxy; return it with its results."""
        options, field = self.options, one.field
        ticks, servo = validate(
            field, frame, points, reference=reference, walls=one.truth.walls, options=options
        )
        feel, surfaces, no_proxy = feel_for(
            field,
            self.beside,
            options.contact,
            size=options.size,
            seconds=servo.compute_us["p50"] * 1e-6,
            deadline=options.deadline,
        )
        proxy = feel and time_proxy(field, feel, surfaces, path=path, options=options)
        return one._replace(ticks=ticks, servo=servo, feel=feel, proxy=proxy, no_proxy=no_proxy)

    def search(self, item):
        """Return the stiffness that is `Safe`, by device.

        ``item`` is a field, whether it is touched through a proxy, and the hand. A field without a
        proxy has no such stiffness: None.
        """
        one, proxied, hand = item
        if proxied and one.feel is None:
            return None
        setup, feel = Setup.of(self.options)._replace(hand=hand), one.feel if proxied else None
        surface = one.truth.surface
        return {
            name: find_safe(one.field, DEVICES[name], surface, setup=setup, feel=feel)
            for name in self.options.devices
        }

    def press(self, item):
        """Press the simulated devices onto a field; return verdicts by device.

        ``item`` is a field, whether the press goes through a proxy, and what `search` returned for
        each hand. A field without a proxy has no such verdicts: None.
        """
        (one, proxied, searched), options = item, self.options
        if proxied and one.feel is None:
            return None
        safe = {name: [by_device[name] for by_device in searched] for name in options.devices}
        truth = one.truth
        if proxied:
            return touch_devices(one.field, one.feel, truth, options=options, safe=safe)
        return press_devices(one.field, truth.surface, truth.walls, options=options, safe=safe)

    def conclude(self, one, devices, touched):
        """Run a field on an attached device, if any. Return arrays and the field's verdict."""
        proxy, ticks, attached = one.proxy, one.ticks, None
        if proxy:
            proxy = proxy.model_copy(update={"devices": touched})
        if self.options.attached:
            felt = _Felt(one.feel, proxy, one.truth) if proxy else None
            more, attached = _attached(
                one.field, one.truth.surface, one.servo,
                devices=devices, options=self.options, felt=felt,
            )  # fmt: skip
            ticks |= {f"device_{key}": values for key, values in more.items()}
        verdict = FieldVerdict(
            **dict(one.servo),
            devices=devices,
            advice=paragraph(one.servo, devices, self.options, proxy=proxy),
            sha256=hashlib.sha256(one.path.read_bytes()).hexdigest(),
            proxy=proxy,
            no_proxy=one.no_proxy,
            attached=attached,
        )
        return ticks, verdict


def _counted(results, report, done=0):
    """Yield results, and report how many there are."""
    for count, result in enumerate(results, done + 1):
        yield result
        report.update(count)


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
    points, normals, distance = (trajectory.arrays[key] for key in ("points", "normal", "distance"))
    start = points[0] - distance[0] * normals[0]
    way = np.linspace(_OUTSIDE, distance[0], _WAY)[:, None]
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


def press_devices(field, surface, walls, *, options, safe=None):
    """Press every configured simulated device onto an object with a field's forces.

    ``walls`` is a `pandis.pipeline.run.records.hardware.WallVerdict`; ``safe`` has the argument of
    `press` by device, if it is known.

    Returns
    -------
    dict of str to pandis.pipeline.run.records.hardware.DeviceVerdict
        By the device's name.
    """
    setup, safe, verdicts = Setup.of(options), safe or {}, {}
    for name in options.devices:
        pressed = press(field, DEVICES[name], surface, setup=setup, safe=safe.get(name))
        verdicts[name] = DeviceVerdict(
            **dict(pressed),
            device=name,
            pressed_missing=walls.pressed_missing,
            holds=walls.holds,
            verdict=judge(pressed, walls),
            sentence=device_sentence(name, pressed, walls),
        )
    return verdicts

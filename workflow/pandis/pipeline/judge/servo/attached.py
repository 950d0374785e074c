"""Runs a field through OpenHaptics on an attached device that a person holds: the last step."""

import os
from typing import NamedTuple

import numpy as np

from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.run.records.hardware import AttachedRun, Pressed, TouchVerdict, WallVerdict
from pandis.runtime.device import DONE, Order, run_device
from pandis.runtime.scene import NativeScene, Placed

STAND_IN = "A stand-in for OpenHaptics ran, not a device: this is not a hardware result."
UNARMED = (
    "A haptic device ({model}) was attached; its positions were read, but no force was sent, "
    "because hardware.attached.arm or the environment variable PANDIS_ARM is not set."
)
REFUSED = (
    "A haptic device ({model}) was attached; its positions were read, but no force was sent "
    "although arming was asked for: {refused}."
)
UNTOUCHED = (
    "A haptic device ({model}) was attached and armed, but the object was not touched: no force."
)
ENDED = "A haptic device ({model}) was attached; the run ended early: {why}."
REAL = "A haptic device ({model}) was attached, and forces were sent to it, through its library."
NONE = "No device ran: {why}."
#: Environment variable that must be 1 for each run with forces; an option would stay set for later
#: runs.
CONSENT = "PANDIS_ARM"
#: An armed device uses the share SHARE of the stiffness that is safe for a hand with the damping
#: HAND (Ns/m).
SHARE, HAND = 0.7, "0.3"


class Span(NamedTuple):
    """Duration of a run on the device, and the longest computation allowed per tick, s."""

    seconds: float
    deadline: float


class Safety(NamedTuple):
    """What is known about a field's safety on a device.

    Attributes
    ----------
    pressed : pandis.pipeline.run.records.hardware.Pressed, optional
        Results of presses with this field, mesh and device: with penalty forces, or through a
        proxy (then a `TouchVerdict`).
    walls : pandis.pipeline.run.records.hardware.WallVerdict, optional
    sound : bool
        Whether the file reproduces its field's forces and computes them in time.
    """

    pressed: Pressed | None = None
    walls: WallVerdict | None = None
    sound: bool = True


_UNKNOWN = Safety()


def stiffness_for(stiffness, spec, safety):
    """Return the stiffness at which a device may be armed, and the reason if it may not be.

    Parameters
    ----------
    stiffness : float
        Configured stiffness, N/m.
    spec : pandis.pipeline.judge.servo.devices.Specification
    safety : Safety

    Returns
    -------
    stiffness : float
        N/m: the least of the configured one, the device's, the gentle one at the device's rate,
        and 0.7 of the safe one for a hand of 0.3 Ns/m.
    refused : str
        Why no force may be sent; empty if forces may be sent.
    """
    (pressed, walls, sound), most = safety, min(stiffness, spec.stiffest(1 / spec.rate))
    if pressed is None or walls is None:
        return most, "no safe stiffness is known for this field on this device"
    if not sound:
        return most, "the file does not give its field's forces, or computes them too slowly"
    if isinstance(pressed, TouchVerdict) and pressed.passes:
        return most, f"walls let its proxy through in {pressed.passes} presses"
    if isinstance(pressed, TouchVerdict) and not pressed.presses:
        return most, "there was no room for a hard press, so nothing is known of its walls"
    if not walls.holds or walls.pressed_missing:
        return most, "the field lacks a part of the surface"
    safe = SHARE * pressed.hands[HAND]
    if not safe > 0:
        return most, f"no stiffness is safe for a hand of {HAND} Ns/m"
    return min(most, safe), ""


def run_attached(field, scale, options, *, span, safety=_UNKNOWN, feel=None):
    """Run one field on the attached device.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    scale : pandis.base.physical.Scale
        With the configured stiffness, which `stiffness_for` limits.
    options : pandis.pipeline.run.ask.options.AttachedOptions
    span : Span
    safety : Safety
        Without verdicts on presses and walls, no force is sent.
    feel : pandis.runtime.contact.Feel, optional
        Probe with a proxy, and its surface; None for penalty forces.

    Returns
    -------
    arrays : dict of str to ndarray
        Per tick, in the device's workspace: ``position`` (m), ``force`` (N); ``taken``, the
        computing time, and ``since``, the time since the last call (s).
    record : pandis.pipeline.run.records.hardware.AttachedRun
    """
    spec = DEVICES[options.model]
    # the device's scheduler has its own rate
    period = 1 / spec.rate
    stiffness, refused = stiffness_for(scale.stiffness, spec, safety)
    consent = options.arm and os.environ.get(CONSENT) == "1"
    armed = consent and not refused
    placed = Placed.at(field, scale.size, stiffness)
    order = Order(
        feel.scene(placed) if feel else NativeScene([placed]),
        max(1, round(span.seconds / period)),
        spec.limits(period, stiffness),
        period,
        span.deadline,
        expected=spec.force,
        armed=armed,
    )
    session = run_device(options.library, options.name, order)
    touched = bool(session.force.any())
    statement = _statement(session, armed, consent, touched=touched).format(
        model=session.model or spec.title, why=session.sentence, refused=refused
    )
    late = session.since - period
    record = AttachedRun(
        statement=statement + _reach(session, scale.size),
        hardware=not session.stand_in and touched and session.cause == DONE,
        stand_in=session.stand_in,
        armed=armed,
        refused=refused if consent else "",
        armed_at=session.armed_at,
        model=session.model,
        contact="proxy" if feel else "penalty",
        ended=session.sentence,
        code=session.code,
        ticks=len(session.force),
        stiffness=stiffness,
        strongest_n=session.strongest,
        steepest_n=session.steepest,
        fastest_m_s=session.fastest,
        cut=session.cut,
        slowed=session.slowed,
        damped=session.damped,
        signs=session.signs,
        energy_j=session.worst,
        late_us=float(np.percentile(late, 99.9) * 1e6) if len(late) else None,
    )
    arrays = {
        "position": session.position,
        "force": session.force,
        "taken": session.taken,
        "since": session.since,
    }
    return arrays, record


def _statement(session, armed, consent, *, touched):
    if not len(session.force):
        return NONE
    if session.stand_in:
        return STAND_IN
    if session.cause != DONE:
        return ENDED
    if not armed:
        return REFUSED if consent else UNARMED
    return REAL if touched else UNTOUCHED


def _reach(session, size):
    """Return a warning if the object, centred in the device's workspace, extends beyond it."""
    room = 1e3 * (np.array(session.report.high) - np.array(session.report.low))
    if (room <= 0).any() or (1e3 * size <= room).all():
        return ""
    box = " x ".join(f"{side:.0f}" for side in room)
    return (
        f" The device's own workspace is {box} mm: parts of an object of {1e3 * size:.0f} mm may "
        "lie beyond it; make device.size smaller."
    )

"""A run on an attached device, through OpenHaptics: the last step, where somebody holds it."""

import os

import numpy as np

from pandis.hardware.devices import DEVICES
from pandis.native.hdapi import DEVICE, DONE, LIBRARY, Order, run_device
from pandis.native.scene import NativeScene, Placed

STAND_IN = "A stand-in for OpenHaptics ran, and no device: nothing of it is a hardware result."
UNARMED = (
    "A haptic device ({model}) was attached; its positions were read and no force was sent, for "
    "hardware.attached.arm or the environment variable PANDIS_ARM is not set."
)
UNTOUCHED = (
    "A haptic device ({model}) was attached and armed; the object was not touched: no force."
)
ENDED = "A haptic device ({model}) was attached; the run ended early: {why}."
REAL = "A haptic device ({model}) was attached, and forces were sent to it, through its library."
NONE = "No device ran: {why}."
#: Seconds until the whole force is given; largest change, share of the largest force per ms.
RAMP, IMPULSE = 0.5, 0.1
#: What must be set to 1, each time anew, for forces to be sent: a configuration stays where it is.
CONSENT = "PANDIS_ARM"


def run_attached(field, size, stiffness, options):
    """Run one field on the attached device.

    Parameters
    ----------
    field : pandis.native.runtime.NativeField
    size, stiffness : float
        Metres of the longest side; N/m, or the device's most if that is less.
    options : dict
        See `pandis.config.AttachedOptions`, and ``seconds`` and ``deadline``.

    Returns
    -------
    arrays : dict of str to ndarray
        Per tick, in the device's workspace: ``position`` (m), ``force`` (N), ``taken`` and
        ``since`` (s).
    found : dict
        ``statement``: what it was that ran; how it ended, and its figures.
    """
    spec = DEVICES[options["model"]]
    # the device's scheduler has a rate of its own
    period = 1 / spec.rate
    given = min(stiffness, spec.stiffness)
    armed = options["arm"] and os.environ.get(CONSENT) == "1"
    order = Order(
        NativeScene([Placed.at(field, size, given)]),
        max(1, round(options["seconds"] / period)),
        spec.limits(RAMP, period, given, IMPULSE * spec.force),
        period,
        options["deadline"],
        expected=spec.force,
        armed=armed,
    )
    session = run_device(options["library"], options["name"], order)
    touched = bool(session.force.any())
    statement = _statement(session, armed, touched).format(
        model=session.model or spec.title, why=session.sentence
    )
    late = session.since - period
    found = {
        "statement": statement,
        "hardware": not session.stand_in and touched and session.cause == DONE,
        "stand_in": session.stand_in,
        "armed": armed,
        "model": session.model,
        "ended": session.sentence,
        "code": session.code,
        "ticks": len(session.force),
        "stiffness": given,
        "strongest_n": session.strongest,
        "steepest_n": session.steepest,
        "fastest_m_s": session.fastest,
        "cut": session.cut,
        "slowed": session.slowed,
        "energy_j": session.worst,
        "late_us": float(np.percentile(late, 99.9) * 1e6) if len(late) else None,
    }
    arrays = {
        "position": session.position,
        "force": session.force,
        "taken": session.taken,
        "since": session.since,
    }
    return arrays, found


def _statement(session, armed, touched):
    if session.cause in (LIBRARY, DEVICE) or not len(session.force):
        return NONE
    if session.stand_in:
        return STAND_IN
    if session.cause != DONE:
        return ENDED
    if not armed:
        return UNARMED
    return REAL if touched else UNTOUCHED

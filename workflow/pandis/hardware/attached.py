"""A run on an attached device, through OpenHaptics: the last step, where somebody holds it."""

import numpy as np

from pandis.frame import UNIT_SIDE
from pandis.hardware.devices import DEVICES
from pandis.native.hdapi import DONE, LIBRARY, Order, run_device
from pandis.native.scene import NativeScene, Placed

STAND_IN = "A stand-in for OpenHaptics ran, and no device: nothing of it is a hardware result."
UNARMED = (
    "The device's positions were read; no force was sent, for hardware.attached.arm is not set."
)
REAL = "A haptic device ({model}) was attached, and forces were sent to it, through its library."
#: Seconds until the whole force is given.
RAMP = 0.5


def run_attached(field, size, stiffness, options):
    """Run one field on the attached device.

    Parameters
    ----------
    field : pandis.native.runtime.NativeField
    size, stiffness : float
        Metres of the longest side; N/m, or the device's most if that is less.
    options : dict
        See `pandis.config.AttachedOptions`, and ``seconds``, ``rate`` and ``deadline``.

    Returns
    -------
    arrays : dict of str to ndarray
        Per tick, in the device's workspace: ``position`` (m), ``force`` (N), ``taken`` and
        ``since`` (s).
    found : dict
        ``statement``: what it was that ran; how it ended, and its figures.
    """
    spec, period = DEVICES[options["model"]], 1 / options["rate"]
    scale = size * field.frame.scale / UNIT_SIDE
    given = min(stiffness, spec.stiffness)
    placed = Placed(field, np.eye(3), -scale * np.array(field.frame.centre), scale, given)
    order = Order(
        NativeScene([placed]),
        max(1, round(options["seconds"] * options["rate"])),
        spec.limits(RAMP, period),
        period,
        options["deadline"],
        armed=options["arm"],
    )
    session = run_device(options["library"], options["name"], order)
    statement = STAND_IN if session.stand_in else REAL.format(model=session.model or spec.title)
    if session.cause == LIBRARY or not len(session.force):
        statement = f"No device ran: {session.sentence}."
    elif not options["arm"] and not session.stand_in:
        statement = UNARMED
    late = session.since - period
    found = {
        "statement": statement,
        "hardware": not session.stand_in and options["arm"] and session.cause == DONE,
        "stand_in": session.stand_in,
        "armed": options["arm"],
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

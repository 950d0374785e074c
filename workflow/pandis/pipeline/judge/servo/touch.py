"""Feel an exported field on a device, without the workflow: ``pandis-touch FIELD.pandis``.

Usage::

    PYTHONPATH=workflow python -m pandis.pipeline.judge.servo.touch FIELD.pandis

With ``--simulated``, a hand leads a simulated device through the object and back, in real time.
Otherwise forces are sent only with ``--arm`` and PANDIS_ARM=1, and only at a stiffness that
``hardware.json``, beside the exports, reports as safe for this exact file. They are penalty forces
or, with ``--proxy``, those of the proxy that was validated.
"""

import argparse
import hashlib
import sys
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from pydantic import ValidationError

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.base.physical import Scale
from pandis.pipeline.judge.servo.attached import Safety, Span, run_attached, stiffness_for
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.proxies import felt_again
from pandis.pipeline.run.ask.options import AttachedOptions, HardwareOptions
from pandis.pipeline.run.records.hardware import HardwareRecord
from pandis.runtime.contact import Feel, Material
from pandis.runtime.device import Order, run_simulated
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed

#: Models that OpenHaptics drives.
ATTACHED = get_args(AttachedOptions.model_fields["model"].annotation)
#: Stiffness (N/m) and damping (Ns/m) of the hand that holds the simulated device.
HAND = (300.0, 6.0)


def digest(path):
    """Return the SHA-256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class Known(NamedTuple):
    """Results of a validation for a file on a device.

    Attributes
    ----------
    pressed, walls
        As for `pandis.pipeline.judge.servo.attached.stiffness_for`.
    why : str
        Why there are no results; empty if there are.
    proxy : pandis.pipeline.run.records.hardware.ProxyVerdict or None
        The proxy's verdict, if it was requested.
    """

    pressed: object = None
    walls: object = None
    why: str = ""
    proxy: object = None


def known(path, model, size, *, through_proxy=False):
    """Return a validation's results for a file on a device, or why there are none.

    Parameters
    ----------
    path : Path
        ``{field}.pandis``, in a folder ``export`` beside ``hardware.json``.
    model : str
        A key of `pandis.pipeline.judge.servo.devices.DEVICES`.
    size : float
        Longest side, m.
    through_proxy : bool
        Whether to look up the results with the proxy instead of those with penalty forces.

    Returns
    -------
    Known
    """
    verdict = path.resolve().parent.parent / "hardware.json"
    if not verdict.is_file():
        return Known(why=f"{verdict} does not exist: run the workflow's hardware stage")
    try:
        report = HardwareRecord.model_validate_json(verdict.read_bytes())
    except ValidationError:
        return Known(why=f"{verdict} is not a report of this version: run the hardware stage")
    validated = report.fields.get(path.stem)
    if validated is None or validated.sha256 != digest(path):
        return Known(why=f"{verdict} is for another file: run the workflow's hardware stage")
    if not abs(report.size / size - 1) <= 1e-6:  # negated so that NaN counts as different
        return Known(why=f"{verdict} is for a longest side of {report.size:g} m: pass it as --size")
    if report.rate != DEVICES[model].rate:
        return Known(why=f"{verdict} is for {report.rate:g} Hz, not this device's rate")
    if not (validated.agrees and validated.in_time):
        return Known(why=f"{verdict} says: {validated.sentence}")
    proxy, devices = None, validated.devices
    if through_proxy:
        proxy = validated.proxy
        if proxy is None:
            return Known(why=f"{verdict} has no proxy: {validated.no_proxy}")
        if not proxy.in_time:
            return Known(why=f"{verdict} says: the proxy's forces take too long to compute")
        devices = proxy.devices
    pressed = devices.get(model)
    if pressed is None:
        return Known(why=f"{verdict} does not cover {model}: add it to hardware.devices")
    return Known(pressed, validated.walls, "", proxy)


def touch_simulated(field, model, size, *, stiffness, seconds, feel=None):
    """Lead a simulated device through the middle of an object and back, in real time.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    model : str
        A key of `pandis.pipeline.judge.servo.devices.DEVICES`.
    size, stiffness, seconds : float
        Longest side, m; stiffness, N/m; duration, s.
    feel : pandis.runtime.contact.Feel, optional
        Probe with a proxy, and its surface; None for penalty forces.

    Raises
    ------
    PandisError
        The field is a grid of forces, which has no proxy.

    Returns
    -------
    pandis.runtime.device.Session
    """
    spec = DEVICES[model]
    period = 1 / spec.rate
    ticks = max(1, round(seconds / period))
    height = 0.6 * size * np.cos(np.linspace(0, 2 * np.pi, ticks))
    rest = np.column_stack([np.zeros(ticks), height, np.zeros(ticks)])
    device = spec.simulated(HAND, delay=0, period=period, wall=stiffness)
    placed = Placed.at(field, size, stiffness)
    scene = feel.scene(placed) if feel else NativeScene([placed])
    # loose limits: a simulated device does no harm if a tick is late
    late = {"deadline": 1.0, "gap": 1.0, "patience": 5.0}
    order = Order(scene, ticks, spec.limits(period, stiffness), period, armed=True, **late)
    return run_simulated(device, rest[0], rest, press=np.zeros(3), order=order, clock=True)


def _feel(field, options, proxy):
    """Return the validated probe with a proxy, or the default one, with the user's options."""
    feel = (
        felt_again(field, proxy, options.size, folder=options.field.resolve().parent)
        if proxy
        else Feel()
    )
    if options.radius is not None:
        feel = feel._replace(radius=options.radius)
    if options.friction is not None:
        rubs = Material(options.friction, options.friction, 0.0, 0.0)
        feel = feel._replace(materials=(rubs,))
    return feel


def describe(session, stiffness):
    """Return a sentence that describes a run."""
    return (
        f"{session.sentence}: {len(session.force):,} ticks at {stiffness:.0f} N/m, at most "
        f"{session.strongest:.2f} N, {session.cut} ticks cut, {session.slowed} slowed, "
        f"{session.damped} damped, {session.signs} signs of an unstable wall"
    )


def main(words=None):
    """Run the program and return its exit status."""
    about = __doc__.split("\n", 1)[0]
    parser = argparse.ArgumentParser("pandis-touch", description=about)
    parser.add_argument("field", type=Path, help="FIELD.pandis, as exported")
    parser.add_argument("--model", choices=DEVICES, default="touch")
    parser.add_argument("--library", default="libHD.so", help="OpenHaptics' library")
    parser.add_argument("--name", default="", help="name of the device; empty: the default one")
    parser.add_argument("--simulated", action="store_true", help="use a simulated device")
    parser.add_argument("--size", type=float, default=0.1, help="longest side, m")
    parser.add_argument("--stiffness", type=float, default=400.0, help="requested stiffness, N/m")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--proxy", action="store_true", help="use a proxy that stays outside walls")
    parser.add_argument("--radius", type=float, help="proxy radius, m; by default as validated")
    parser.add_argument("--friction", type=float, help="friction coefficient (default: validated)")
    parser.add_argument("--arm", action="store_true", help="send forces; requires PANDIS_ARM=1")
    line = parser.parse_args(words)
    if not line.simulated and line.model not in ATTACHED:
        parser.error(f"only {' and '.join(ATTACHED)} can be attached; others need --simulated")
    overrides = [value for value in (line.radius, line.friction) if value is not None]
    if overrides and not (line.proxy and line.simulated):
        parser.error("--radius and --friction require --simulated --proxy: a real device uses the "
                     "contact that was validated")  # fmt: skip
    if not all(value >= 0 for value in overrides):
        parser.error("--radius and --friction must be 0 or more")
    try:
        field = NativeField(line.field)
    except PandisError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    validated = known(line.field, line.model, line.size, through_proxy=line.proxy)
    safety, why = Safety(validated.pressed, validated.walls), validated.why
    feel = _feel(field, line, validated.proxy) if line.proxy else None
    print(f"{line.field}: longest side {UNIT_SIDE / field.frame.scale:g} in the mesh's units")
    if why:
        print(f"no safe stiffness is known: {why}")
    if line.simulated:
        most = min(line.stiffness, DEVICES[line.model].stiffness)
        stiffness = most if why else stiffness_for(most, DEVICES[line.model], safety)[0]
        try:
            session = touch_simulated(
                field, line.model, line.size, stiffness=stiffness, seconds=line.seconds, feel=feel
            )
        except PandisError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        print(f"A simulated device ran, and no other. It {describe(session, stiffness)}.")
        return 0
    options = AttachedOptions(library=line.library, name=line.name, model=line.model, arm=line.arm)
    span = Span(line.seconds, HardwareOptions().deadline)
    scale = Scale(line.size, line.stiffness)
    try:
        _, run = run_attached(field, scale, options, span=span, safety=safety, feel=feel)
    except PandisError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(run.statement)
    print(f"The run ended: {run.ended}; the largest force was {run.strongest_n:.2f} N.")
    return 0


if __name__ == "__main__":
    sys.exit(main())

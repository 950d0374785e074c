"""Puts into words the verdicts and advice on a field, for this machine and for each device."""

from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.pressing import SLACK
from pandis.pipeline.judge.servo.walls import faults as force_faults
from pandis.pipeline.judge.stress.coupled import CALM


def judge(pressed, walls):
    """Return ``pass`` or ``fail``, given presses with a device and a comparison of forces."""
    whole = walls.holds and not walls.pressed_missing
    return "pass" if whole and _is_good(pressed) else "fail"


def _is_good(pressed):
    """Return whether a pressed device stays within its limits, keeps still and gains no energy."""
    good = pressed.within_limits and pressed.passive and pressed.quiet >= CALM
    return bool(good and not pressed.unarmed and pressed.safe_n_m >= pressed.stiffness)


def machine_verdict(servo):
    """Return the servo loop's verdict on a field on this machine.

    Parameters
    ----------
    servo : pandis.pipeline.run.records.hardware.ServoVerdict

    Returns
    -------
    str
        ``fail``: the forces are not the evaluated ones, or differ too much from the exact ones, or
        take too long to compute. ``late``: the field passed, but the machine began ticks
        too late, so there is no verdict. ``pass``: otherwise.
    """
    if not (servo.agrees and servo.in_time and servo.walls.holds):
        return "fail"
    return "pass" if servo.punctual else "late"


def proxy_verdict(touched):
    """Return ``pass`` or ``fail`` for a device that pressed through a proxy.

    If there was no room for hard presses, walls were not tested: the verdict is ``fail``.

    Parameters
    ----------
    touched : pandis.pipeline.run.records.hardware.TouchVerdict
    """
    sound = touched.holds and touched.presses and not touched.passes
    return "pass" if sound and _is_good(touched) else "fail"


def proxy_sentence(touched):
    """Return a sentence about a field felt through a proxy on a simulated device."""
    clauses = (
        f"no wall lets it through in {touched.presses} presses of 1.2 times the largest force "
        f"({touched.penalty_passes} with penalty forces)"
    )
    if touched.passes:
        clauses = (
            f"walls let it through in {touched.passes} of {touched.presses} presses "
            f"({touched.penalty_passes} with penalty forces)"
        )
    if not touched.presses:
        clauses = "there is no room to press it hard, so nothing is known of its walls"
    faults = [*_faults(touched.device, touched), *_unrest(touched)]
    if not touched.holds:
        faults.append("the field's forces are not the exact ones")
    light = min(touched.hands, key=float)
    advice = "do not use it"
    if touched.safe_n_m and touched.holds and touched.presses and not touched.passes:
        advice = (
            f"use at most {touched.safe_n_m:.0f} N/m ({touched.limited_by}), in a light hand "
            f"at most {touched.hands[light]:.0f}"
        )
    return f"Through a proxy: {'; '.join([clauses, *faults, advice])}."


def device_sentence(name, pressed, walls):
    """Return a sentence about a field on the simulated device called ``name``.

    Parameters
    ----------
    name : str
        A key of `pandis.pipeline.judge.servo.devices.DEVICES`.
    pressed : pandis.pipeline.run.records.hardware.Pressed
    walls : pandis.pipeline.run.records.hardware.WallVerdict
    """
    device = DEVICES[name]
    faults = _faults(name, pressed)
    faults += _compared(walls)
    faults += _unrest(pressed)
    says = "; ".join(faults) or (
        f"at most {pressed.strongest_n:.2g} of its {device.force:g} N, {_still(pressed)} and "
        f"{_energy(pressed)}"
    )
    safe, light = pressed.safe_n_m, min(pressed.hands, key=float)
    use = safe and not walls.pressed_missing and walls.holds
    advice = "do not use it"
    if use:
        advice = (
            f"with such a hand use at most {safe:.0f} N/m ({pressed.limited_by}), with a light "
            f"one of {light} Ns/m at most {pressed.hands[light]:.0f} N/m"
        )
    hand = f"in a hand of {pressed.hand:g} Ns/m"
    return f"On a simulated {device.title} {hand} at {pressed.stiffness:g} N/m: {says}; {advice}."


def _compared(walls):
    """Return how a field's forces differ from the exact ones, as clauses."""
    clauses = force_faults(walls)
    if walls.pressed_missing:
        at = walls.pressed_missing
        clauses.append(f"the force is missing at {at} of the points that a device presses on")
    return clauses


def _instead(walls):
    """Return what to do instead of using a field that fails."""
    if walls.left_out > MISSING_LIMIT:
        return "No field of this object can be judged: make device.size larger."
    return "Use a larger field, or the exact one."


def _faults(name, pressed):
    """Return how a press exceeds its limits, as clauses."""
    device, faults = DEVICES[name], []
    if pressed.ended:
        faults.append(f"a run ended early ({pressed.ended})")
    if pressed.cut:
        faults.append(f"{pressed.cut} ticks required more than its {device.force:g} N")
    if pressed.reach_m > device.workspace:
        reach, radius = 1e3 * pressed.reach_m, 1e3 * device.workspace
        faults.append(
            f"the object reaches {reach:.0f} mm from the middle of a workspace with a radius of "
            f"{radius:.0f} mm: make device.size smaller"
        )
    if pressed.unarmed:
        faults.append(
            f"{pressed.unarmed} presses got no force, because the field also pushes in free space "
            "and a device is armed only where there is no force"
        )
    return faults


def _unrest(pressed):
    """Return clauses that state whether a press shakes and whether its wall gives energy."""
    faults = [_still(pressed)] if pressed.quiet < CALM else []
    return faults if pressed.passive else [*faults, f"the wall {_energy(pressed)}"]


def _still(pressed):
    if pressed.quiet >= 1:
        return "it keeps still"
    share = f"it shakes or is not held on {100 * (1 - pressed.quiet):.0f} % of the points"
    return f"{share} ({100 * (1 - CALM):.0f} % allowed)"


def _energy(pressed):
    if pressed.energy_j >= 0:
        return "gives no energy"
    lost = f"{-1e3 * pressed.energy_j:.2g} mJ more than the device loses"
    return f"gives {lost} ({1e3 * SLACK:.2g} may be rounding)"


def machine_sentence(servo, options):
    """Return a sentence on whether a field keeps up with the rate on this machine."""
    rate, deadline = options.rate, 1e6 * options.deadline
    took = servo.compute_us["p99.9"]
    if not servo.agrees:
        return "Do not use this file: its forces are not those of the field; export it again."
    if not servo.in_time:
        return (
            f"It does not hold {rate:g} Hz here: {100 * servo.miss_share:.2g} % of the ticks "
            f"compute longer than {deadline:.0f} µs; use a smaller field, or a faster machine."
        )
    if not servo.walls.holds:
        return f"Do not use it: {'; '.join(_compared(servo.walls))}. {_instead(servo.walls)}"
    if not servo.punctual:
        return (
            f"Not judged: the machine was late. {100 * servo.late_share:.2g} % of the ticks "
            f"began more than {deadline:.0f} µs late, which is not the field's doing: it takes at "
            f"most {took:.3g} µs in 99.9 % of them. Stop other programs and validate again."
        )
    return f"It holds {rate:g} Hz here: {took:.3g} of {deadline:.0f} µs in 99.9 % of the ticks."


def paragraph(servo, devices, options, *, proxy=None):
    """Return the advice on a field: the sentence on the machine, then those on each device."""
    sentences = [machine_sentence(servo, options)]
    if proxy and not proxy.touching_share:
        sentences.append(
            "The proxy touched nothing along the trajectory, so its time is not known. It did "
            "not start in the field's free space."
        )
    elif proxy and not proxy.in_time:
        sentences.append(
            f"A proxy does not hold the rate here: {100 * proxy.miss_share:.2g} % of ticks take "
            "too long to compute; make contact.queries smaller, or use another field."
        )
    for name, device in devices.items():
        sentences.append(device.sentence)
        sentences += [proxy.devices[name].sentence] if proxy and name in proxy.devices else []
    return " ".join(sentences)

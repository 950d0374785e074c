"""What a person should do about a field, on this machine and on each device, in a paragraph."""

from pandis.hardware.devices import DEVICES
from pandis.hardware.pressing import SLACK
from pandis.stress.coupled import CALM


def judge(found):
    """Return ``pass`` or ``fail`` for what `pandis.hardware.pressing.press` has found."""
    good = found["within_limits"] and found["passive"] and found["quiet"] >= CALM
    good = good and not found["pressed_missing"] and not found["unarmed"] and found["holds"]
    return "pass" if good and found["safe_n_m"] >= found["stiffness"] else "fail"


def machine_verdict(verdict):
    """Return what the servo loop says of a field on this machine.

    Parameters
    ----------
    verdict : dict
        ``agrees``, ``in_time``, ``punctual`` and ``walls`` of `pandis.hardware.validation`.

    Returns
    -------
    str
        ``fail``: the file does not give the forces that were evaluated, or lacks those of the exact
        field, or computes too long; ``late``: none of this, but the machine began ticks too late,
        for which no field can be blamed, so that nothing is said for it either; ``pass``.
    """
    if not (verdict["agrees"] and verdict["in_time"] and verdict["walls"]["holds"]):
        return "fail"
    return "pass" if verdict["punctual"] else "late"


def device_sentence(found):
    """Say what a simulated device made of a field.

    Parameters
    ----------
    found : dict
        From `pandis.hardware.pressing.press`, with ``device``.
    """
    device = DEVICES[found["device"]]
    faults = []
    if found["ended"]:
        faults.append(f"a run ended early ({found['ended']})")
    if found["cut"]:
        faults.append(f"{found['cut']} ticks wanted more than its {device.force:g} N")
    if found["reach_m"] > device.workspace:
        reach, radius = 1e3 * found["reach_m"], 1e3 * device.workspace
        faults.append(
            f"the object reaches {reach:.0f} mm from the middle of a workspace of {radius:.0f} mm: "
            "make device.size smaller"
        )
    if found["unarmed"]:
        faults.append(
            f"{found['unarmed']} presses got no force, for the field pushes in free space, too, "
            "and a device is armed outside of every force"
        )
    still = "it keeps still"
    if found["quiet"] < 1:
        share = f"it shakes or is not held on {100 * (1 - found['quiet']):.0f} % of the points"
        still = f"{share} ({100 * (1 - CALM):.0f} % may)"
    energy = "gives no energy"
    if found["energy_j"] < 0:
        lost = f"{-1e3 * found['energy_j']:.2g} mJ more than the device loses"
        energy = f"gives {lost} ({1e3 * SLACK:.2g} may be rounding)"
    if found["pressed_missing"]:
        faults.append(
            f"at {found['pressed_missing']} of the points that it presses on the force is missing"
        )
    if not found["holds"]:
        faults.append("the field lacks a part of the surface")
    if found["quiet"] < CALM:
        faults.append(still)
    if not found["passive"]:
        faults.append(f"the wall {energy}")
    says = "; ".join(faults) or (
        f"at most {found['strongest_n']:.2g} of its {device.force:g} N, {still} and {energy}"
    )
    safe, light = found["safe_n_m"], min(found["hands"], key=float)
    use = safe and not found["pressed_missing"] and found["holds"]
    advice = "do not use it"
    if use:
        advice = (
            f"with such a hand use at most {safe:.0f} N/m ({found['limited_by']}), with a light "
            f"one of {light} Ns/m at most {found['hands'][light]:.0f} N/m"
        )
    hand = f"in a hand of {found['hand']:g} Ns/m"
    return f"On a simulated {device.title} {hand} at {found['stiffness']:g} N/m: {says}; {advice}."


def machine_sentence(verdict, options):
    """Say whether a field holds the rate on this machine."""
    rate, deadline = options["rate"], 1e6 * options["deadline"]
    took = verdict["compute_us"]["p99.9"]
    if not verdict["agrees"]:
        return "Do not use this file: its forces are not those of the field; export it again."
    if not verdict["in_time"]:
        return (
            f"It does not hold {rate:g} Hz here: {100 * verdict['miss_share']:.2g} % of the ticks "
            f"compute longer than {deadline:.0f} µs; use a smaller field, or a faster machine."
        )
    if not verdict["walls"]["holds"]:
        lacks = 100 * verdict["walls"]["missing"]
        return (
            f"Do not use it: on {lacks:.2g} % of the surface the force is missing that the exact "
            "field has; take a larger field, or the exact one."
        )
    if not verdict["punctual"]:
        return (
            f"Not judged: the machine was late. {100 * verdict['late_share']:.2g} % of the ticks "
            f"began more than {deadline:.0f} µs late, which is not the field's doing: it takes at "
            f"most {took:.3g} µs in 99.9 % of them. Stop other programs and validate again."
        )
    return f"It holds {rate:g} Hz here: {took:.3g} of {deadline:.0f} µs in 99.9 % of the ticks."


def paragraph(verdict, devices, options):
    """Return what to do about a field: the machine's sentence, then one for each device."""
    own = [device_sentence(found) for found in devices.values()]
    return " ".join([machine_sentence(verdict, options), *own])

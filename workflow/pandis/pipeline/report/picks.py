"""Picks the files of a mesh to use, and describes their error, size, time and safe stiffness."""

from pandis.pipeline.judge.errors.front import may_be_used
from pandis.pipeline.judge.servo.attached import SHARE


def picks(rows, hardware, folder):
    """Return the files to use: those of the exact field and of the best other field.

    Parameters
    ----------
    rows, hardware
        As for `usable`.
    folder : Path
        Folder of the mesh's results.

    Returns
    -------
    list of dict
        ``field`` and ``file``. Texts: ``error``, ``size``, ``time``, ``safe`` (a sentence on the
        safe stiffness), ``why`` (the start of a sentence) and ``through`` (empty, or a sentence
        that says to use a proxy, because hard presses go through walls with penalty forces).
        Numbers, of which ``stiffness`` is the safe stiffness.
    """
    able, tried = usable(rows, hardware), hardware.fields
    exact = [row for row in able if row["contact_mean"] == 0]
    exact = sorted(exact, key=lambda row: row["field"] != "exact")[:1]  # else an exact `auto`
    others = [row for row in able if row["contact_mean"] > 0]
    best = [min(others, key=lambda row: row["contact_mean"])] if others else []
    picked = [_pick(row, tried[row["field"]], folder) | {"why": "Use"} for row in exact + best]
    if exact and best:
        picked[1]["why"] = _why(*best, *exact)
    return picked


def usable(rows, hardware):
    """Return the rows of the fields that may be used.

    A field is judged twice: by its evaluation (`may_be_used`), and by its exported file in a servo
    loop. The file must answer in time, push back on the whole surface, and be safe at some
    stiffness on every simulated device.

    Parameters
    ----------
    rows : list of dict
        Rows of a summary: one mesh's fields.
    hardware : pandis.pipeline.run.records.hardware.HardwareRecord
    """
    tried = hardware.fields
    return [
        row
        for row in rows
        if row["field"] in tried and may_be_used(row) and _file_is_sound(tried[row["field"]])
    ]


def _why(row, exact):
    """Return the start of a sentence that states a field's advantage over the exact field."""
    if row["bytes"] < exact["bytes"]:
        return "Or, if that is too large,"
    faster = row["native_p50_us"] < exact["native_p50_us"]
    return "Or, if that is too slow," if faster else "Of the others the best is"


def _file_is_sound(verdict):
    """Return whether the validation of an exported file found nothing that forbids its use."""
    devices = verdict.devices.values()
    pressed = all(device.holds and not device.pressed_missing for device in devices)
    holds = not any(touched.passes for touched in _touched(verdict))
    if _lets_through(verdict)[0]:  # the field is recommended with a proxy
        holds = holds and verdict.proxy.in_time
    whole = verdict.agrees and verdict.in_time and verdict.walls.holds and pressed and holds
    return bool(whole and _safe(verdict) != 0)


def _touched(verdict):
    """Return the devices' verdicts on a field touched through a proxy; empty if it has no proxy."""
    return list(verdict.proxy.devices.values()) if verdict.proxy else []


def _lets_through(verdict):
    """Return how many hard presses penalty forces let through, and how many there were in all.

    Both numbers are those of the worst device.
    """
    counts = [(t.penalty_passes, t.presses) for t in _touched(verdict)]
    return max(counts, default=(0, 0))


def _safe(verdict):
    """Return the stiffness that is safe in the lightest hand on every device; None without devices.

    It applies to the recommended force: the proxy's if penalty forces let hard presses through.
    """
    felt = _touched(verdict) if _lets_through(verdict)[0] else verdict.devices.values()
    hands = [device.hands for device in felt]
    return min((most[min(most, key=float)] for most in hands), default=None)


def _pick(row, verdict, folder):
    error, most = "no error", _safe(verdict)
    if row["contact_mean"] > 0:
        percent = f"{row['contact_percent']:.2g} % of the force"
        error = f"{row['contact_millinewtons']:.3g} mN ({percent})"
    safe = "No device was simulated."
    if most is not None:
        safe = (
            f"In simulation it is safe up to {most:,.0f} N/m in a light hand; an armed device "
            f"gets at most {SHARE} of the stiffness that is safe on that device."
        )
    passes, presses = _lets_through(verdict)
    through = ""
    if passes:
        through = (
            f"Use it through a proxy: with penalty forces {passes} of {presses} hard presses went "
            "through a wall, with a proxy none."
        )
    return {
        "field": row["field"],
        "through": through,
        "file": f"{folder}/export/{row['field']}.pandis",
        "error": error,
        "size": _size(row["bytes"]),
        "time": f"{row['native_p50_us']:.2g} µs",
        "safe": safe,
        "millinewtons": row["contact_millinewtons"],
        "percent": row["contact_percent"],
        "bytes": row["bytes"],
        "microseconds": row["native_p50_us"],
        "stiffness": most,
    }


def _size(count):
    if count < 1000:
        return "under 1 KB"
    return f"{count / 1e6:,.1f} MB" if count >= 1e6 else f"{count / 1e3:,.0f} KB"

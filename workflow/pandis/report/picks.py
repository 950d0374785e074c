"""Which file of a mesh to use: its error, size, time and safe stiffness, in words."""

from pandis.evaluation.front import may_be_used


def picks(rows, hardware, folder):
    """Return the exact field and the best of the others, of those that may be used.

    Parameters
    ----------
    rows : list of dict
        From `pandis.report.tables.summary_rows`.
    hardware : dict
        Attributes of the hardware artifact: only what has a file for ``pandis.h`` is in it.
    folder : path-like
        Of the mesh's results.

    Returns
    -------
    list of dict
        ``field``, ``file``, and texts: ``error``, ``size``, ``time``, ``most`` (the safe
        stiffness), ``safe`` (a sentence about it).
    """
    able = [row for row in rows if row["field"] in hardware["fields"] and may_be_used(row)]
    exact = [row for row in able if row["contact_mean"] == 0][:1]
    others = [row for row in able if row["contact_mean"] > 0]
    best = [min(others, key=lambda row: row["contact_mean"])] if others else []
    return [_pick(row, hardware["fields"][row["field"]], folder) for row in exact + best]


def _pick(row, tried, folder):
    error = "no error"
    if row["contact_mean"] > 0:
        percent = f"{row['contact_percent']:.2g} % of the force"
        error = f"{row['contact_millinewtons']:.3g} mN ({percent})"
    devices = tried.get("devices", {})
    hands = [device["hands"] for device in devices.values()]
    most = min((own[min(own, key=float)] for own in hands), default=None)
    if most is None:
        safe, told = "No device was simulated.", "not known"
    else:
        told = f"{most:,.0f} N/m"
        safe = f"It is safe up to {told} in a light hand, by simulation; a device that is armed "
        safe += "gets at most 0.7 of that."
        if not most:
            safe = "At no stiffness that was tried is it safe in a light hand."
    return {
        "field": row["field"],
        "file": f"{folder}/export/{row['field']}.pandis",
        "error": error,
        "size": _size(row["bytes"]),
        "time": f"{row['native_p50_us']:.2g} µs",
        "most": told,
        "safe": safe,
    }


def _size(count):
    return f"{count / 1e6:,.1f} MB" if count >= 1e6 else f"{count / 1e3:,.0f} KB"

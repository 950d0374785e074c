"""Recommends fields: those that no other beats, and the best for each allowed error."""

from pandis.pipeline.geometry.shares import MISSING_LIMIT

#: Errors that a user may allow, in percent of the mean force on the contact set; the last allows
#: any error.
ERRORS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, float("inf"))
#: Keys of a summary's rows, each with the word for the field that has the smallest value.
PRICES = {"native_p50_us": "fastest", "bytes": "smallest", "jump_rms_newtons": "smoothest"}
#: Criteria by which fields are compared: keys of a summary's rows.
AXES = ("contact_mean", "native_p50_us", "bytes", "jump_rms_newtons")


def may_be_used(row):
    """Return whether a field can be recommended: it passed the stress suite, and little is missing.

    Neither the share of missing surface nor the share too thin to judge may exceed the limit.

    Parameters
    ----------
    row : dict
        A row of a summary. A field without results of the stress suite counts as failed.
    """
    if row["stress"] == "" or row["missing_percent"] == "":
        return False
    worst = max(row["missing_percent"], row["left_out_percent"])
    return row["stress"] == 0 and worst <= 100 * MISSING_LIMIT


def pareto(rows, keys):
    """Return which of the usable rows are beaten by no other row.

    Parameters
    ----------
    rows : list of dict
    keys : sequence of str
        Keys of the values to minimise. A row with an empty value is not compared.

    Returns
    -------
    list of bool
        False for a row that is not compared, or that is worse than some other row in at least one
        key and better in none.
    """
    known = [tuple(row[key] for key in keys) if may_be_used(row) else () for row in rows]
    known = [point if point and "" not in point else None for point in known]

    def beaten(point):
        return any(
            other != point and all(a <= b for a, b in zip(other, point, strict=True))
            for other in known
            if other is not None
        )

    return [point is not None and not beaten(point) for point in known]


def recommend(rows):
    """Return the fastest, smallest and smoothest field for each allowed error.

    Parameters
    ----------
    rows : list of dict
        Rows of a summary: one mesh's fields. Those that may not be used are ignored.

    Returns
    -------
    list of dict
        ``percent``: the allowed error. Under each name of `PRICES`: the row to use, or None.
        Errors that change no recommendation are omitted.
    """
    table = []
    for percent in ERRORS:
        good = [r for r in rows if may_be_used(r) and r["contact_percent"] <= percent]
        picks = {}
        for key, name in PRICES.items():
            priced = [row for row in good if row[key] != ""]
            picks[name] = min(priced, key=lambda row: row[key]) if priced else None
        same = table and all(table[-1][name] is picks[name] for name in picks)
        if any(picks.values()) and not same:
            table.append({"percent": percent, **picks})
    return table

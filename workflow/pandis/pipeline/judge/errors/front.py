"""Which field to use: those that no other beats, and the best for a given error."""

from pandis.pipeline.geometry.shares import MISSING_LIMIT

#: Errors that a user may allow, in percent of the mean force on the contact set; the last allows
#: any error.
ERRORS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, float("inf"))
#: Prices of a field: keys of a summary's rows, and the name of the best by each.
PRICES = {"native_p50_us": "fastest", "bytes": "smallest", "jump_rms_newtons": "smoothest"}
#: Criteria that fields are compared by: keys of a summary's rows.
AXES = ("contact_mean", "native_p50_us", "bytes", "jump_rms_newtons")


def may_be_used(row):
    """Tell whether a field can be recommended: it failed no question and misses no surface.

    Nor is a field recommended if too much of its object is too thin to be judged.

    Parameters
    ----------
    row : dict
        A row of a summary. A question that was not asked counts as not passed.
    """
    if row["stress"] == "" or row["missing_percent"] == "":
        return False
    worst = max(row["missing_percent"], row["left_out_percent"])
    return row["stress"] == 0 and worst <= 100 * MISSING_LIMIT


def pareto(rows, keys):
    """Tell which rows no other row beats, of those that may be used.

    Parameters
    ----------
    rows : list of dict
    keys : sequence of str
        Values that should be small. A row without one of them is not compared.

    Returns
    -------
    list of bool
        False for a row that another one equals or beats in every key, and beats in one.
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
    """Return the fastest, smallest and smoothest field for each error that may be allowed.

    Parameters
    ----------
    rows : list of dict
        Rows of a summary: one mesh's fields. Those that may not be used are left out.

    Returns
    -------
    list of dict
        ``percent``: the error; and by `PRICES`'s names the row to take, or None. An error that
        changes no recommendation is left out.
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

"""Draw the charts at the top of the pages of docs/benchmarks, from docs/figures."""

import io
import re
from statistics import fmean

import matplotlib as mpl
from matplotlib.figure import Figure

import tables

IMAGES = tables.ROOT / "docs/images"
#: Colours that also differ in brightness, so they can be distinguished in grey.
COLOURS = ("#1b6ca8", "#e08e2b", "#7d8a97")
#: Options that give the same bytes in every run, and keep text as text.
STYLE = {"svg.hashsalt": "pandis", "svg.fonttype": "none", "font.size": 9,
         "axes.spines.top": False, "axes.spines.right": False}  # fmt: skip
SCANS = ("bunny", "armadillo", "dragon")


def charts():
    """Return path and SVG text of every chart."""
    drawn = {
        "accuracy": _accuracy, "size": _size, "query-time": _query_time, "building": _building,
        "contact": _contact, "simulators": _simulators, "ablations": _ablations,
    }  # fmt: skip
    with mpl.rc_context(STYLE):
        return {IMAGES / f"{name}.svg": _svg(draw()) for name, draw in drawn.items()}


def _rows(name, **where):
    """Return the rows of a table of docs/figures whose columns have the given values."""
    _, rows = tables.read_figures(name)
    return [row for row in rows if all(row[key] == value for key, value in where.items())]


def _svg(figure):
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None}, facecolor="white")
    text = stream.getvalue()
    # Identifiers are hashes of coordinates, whose last bits depend on the processor: number them.
    hashed = dict.fromkeys(re.findall(r'id="([a-z][0-9a-f]{10})"', text))
    for number, name in enumerate(hashed, 1):
        text = text.replace(name, f"{name[0]}{number}")
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def _bars(groups, xlabel, log=True):
    """Draw horizontal bars.

    Parameters
    ----------
    groups : dict of str to dict of str to float
        Values by label, for each colour; labels without a value have no bar.
    """
    labels = list(dict.fromkeys(label for values in groups.values() for label in values))
    figure = Figure(figsize=(7.2, 0.7 + 0.2 * len(labels) * (0.4 + len(groups))), layout="tight")
    axes = figure.subplots()
    high = 0.8 / len(groups)
    for i, ((name, values), colour) in enumerate(zip(groups.items(), COLOURS, strict=False)):
        places = [labels.index(label) + (i - (len(groups) - 1) / 2) * high for label in values]
        bars = axes.barh(places, values.values(), high, color=colour, label=name)
        axes.bar_label(bars, [f"{value:,.3g}" for value in values.values()], padding=2, fontsize=8)
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.set_xlabel(xlabel)
    if log:
        axes.set_xscale("log")
    if len(groups) > 1:
        axes.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    axes.margins(x=0.12)
    return figure


def _accuracy():
    rows = _rows("default", mesh="bunny")
    rows = [row for row in rows if row["contact_millinewtons"]]  # the controls have none
    errors = {row["field"]: float(row["contact_millinewtons"]) for row in rows}
    none = ", ".join(field for field in errors if errors[field] == 0)
    errors = {field: error for field, error in errors.items() if error > 0}
    return _bars({"": errors}, f"bunny: mean error of the contact force (mN); 0: {none}")


def _size():
    figure = Figure(figsize=(7.2, 2.6), layout="tight")
    for axes, mesh in zip(figure.subplots(1, 3, sharey=True), SCANS, strict=True):
        for kind, colour in zip(("compact-auto", "spline-auto"), COLOURS, strict=False):
            rows = _rows("small", mesh=mesh, kind=kind)
            sizes = [int(row["budget"]) / 1000 for row in rows]
            errors = [1e3 * float(row["contact"]) for row in rows]
            axes.loglog(sizes, errors, "o-", color=colour, label=kind, markersize=3)
        axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
        axes.minorticks_off()
        axes.set_title(mesh, fontsize=9)
        axes.set_xlabel("KB at most")
    figure.axes[0].set_ylabel("contact error × 1e3")
    figure.axes[0].legend(frameon=False)
    return figure


def _query_time():
    rows = _rows("native", way="pandis.h")
    times = {row["field"]: float(row["median_us"]) for row in rows}
    return _bars({"": times}, "one query in a loop, median (µs)")


def _building():
    ratios = {
        case: {row["what"]: float(row["ratio"]) for row in _rows("distances", case=f"ours, {case}")}
        for case in ("every sign checked", "unchecked")
    }
    return _bars(ratios, "speed, as a multiple of libigl's (pseudonormals)", log=False)


def _contact():
    shares = {"penalty force": {}, "proxy": {}}
    rows = [row for row in _rows("presses") if row["presses"] and int(row["presses"])]
    for shape in dict.fromkeys(row["shape"] for row in rows):
        chosen = [row for row in rows if row["shape"] == shape]
        presses = sum(int(row["presses"]) for row in chosen)
        for name, column in zip(shares, ("penalty_passes", "passes"), strict=True):
            shares[name][shape] = 100 * sum(int(row[column] or 0) for row in chosen) / presses
    return _bars(shares, "presses that went through the wall (%)", log=False)


def _simulators():
    fields = ("native-6", "tricubic-64", "spline-800K", "compact-16")
    exact = max(float(row["contact_mn"]) for row in _rows("simulator", field="exact"))
    errors = {
        scene: {row["field"]: float(row["contact_mn"]) for row in _rows("simulator", scene=scene)
                if row["field"] in fields}
        for scene in ("ball", "peg", "bolt")
    }  # fmt: skip
    return _bars(errors, f"error of the contact force in MuJoCo (mN); exact: {exact:.0e} at most")


def _ablations():
    fields = ("nearest-box-64", "trilinear-box-64", "pandis", "spline-auto", "pandis-exact")
    errors = {mesh: {} for mesh in SCANS}
    for mesh, values in errors.items():
        rows = _rows("full", mesh=mesh)
        for field in fields:
            trained = [1e3 * float(row["contact"]) for row in rows if row["field"] == field]
            values[field] = fmean(trained)
    return _bars(errors, "contact error × 1e3, mean of all trainings", log=False)

"""The figures of the report."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from pandis.base.forces import penalty_force
from pandis.pipeline.judge.errors.front import may_be_used, pareto
from pandis.pipeline.report.picture import save
from pandis.pipeline.report.render import VIEW, render
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.records.samples import SamplesRecord

_COLOURS = {form: one for kind in KINDS.values() for form, one in kind.colours.items()}
_COLOURS[AUTO] = "#e4572e"
_UNCHANGED, _CAP = (176, 190, 214), (60, 160, 90)
#: Colours of trained fields, in order.
_LEARNED = ("#d62828", "#f3722c", "#b5179e", "#f48fb1", "#7f1d1d", "#ff7f50")
#: Colour of a field whose kind defines none for it.
_OTHER = "#708090"


def colour(spec, networks):
    """Return the colour of a field, the same in all figures."""
    if spec.learned:
        return _LEARNED[networks.index(spec.name) % len(_LEARNED)]
    return _COLOURS.get(spec.form, _OTHER)


def picture(vertices, faces, path):
    """Draw a mesh and the trajectory on it (unit frame)."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    _show(figure.add_subplot(), vertices, faces, view=VIEW, points=path)
    figure.axes[0].set_title("")
    return save(figure)


def heat_map(vertices, faces, origin, *, moved):
    """Draw a repaired mesh from two sides: which faces were kept, moved (how far), or added.

    Parameters
    ----------
    vertices, faces : ndarray
        Unit frame.
    origin : ndarray, shape (F,)
        See `pandis.pipeline.mesh.deviation.ORIGINS`.
    moved : ndarray, shape (F,)
        Distance of each face from the source, as a share of the mesh's diagonal.
    """
    percent = 100 * moved
    moved = percent[origin == 1]
    norm = mpl.colors.Normalize(0, max(moved.max(initial=0.0), 0.01))
    colours = np.full((len(faces), 3), _UNCHANGED, float)
    colours[origin == 1] = 255 * mpl.colormaps["plasma"](norm(moved))[:, :3]
    colours[origin == 2] = _CAP
    figure = Figure(figsize=(11, 5), layout="constrained")
    for index, view in enumerate((VIEW, [-v for v in VIEW])):
        _show(figure.add_subplot(1, 2, index + 1), vertices, faces, view=view, colours=colours)
    for colour, name in ((_UNCHANGED, "kept"), (_CAP, "cap of a hole")):
        figure.axes[0].plot([], [], "s", color=np.array(colour) / 255, label=name)
    figure.legend(frameon=False, loc="outside lower center", ncols=2)
    bar = figure.colorbar(mpl.cm.ScalarMappable(norm, "plasma"), ax=figure.axes, shrink=0.7)
    bar.set_label("cut or moved: distance to the source\n(% of the diagonal)")
    return save(figure)


def holding(vertices, faces, pushed, *, holding_newtons):
    """Draw, from two sides, the largest force with which a mesh's walls resist a push.

    Parameters
    ----------
    vertices, faces : ndarray
        Unit frame.
    pushed : ndarray, shape (n, 3)
        Points of the surface, unit frame.
    holding_newtons : ndarray, shape (n,)
        Largest force that resists a push at each point, N.
    """
    _, nearest = cKDTree(pushed).query(vertices[faces].mean(axis=1), k=3)
    newtons = holding_newtons[nearest].mean(axis=1)
    strongest = max(holding_newtons.max(), 2e-2)
    weakest = min(max(holding_newtons.min(), 1e-2), strongest / 4)
    norm = mpl.colors.LogNorm(weakest, strongest)
    colours = 255 * mpl.colormaps["viridis"](norm(newtons))[:, :3]
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    for index, view in enumerate((VIEW, [-v for v in VIEW])):
        _show(figure.add_subplot(1, 2, index + 1), vertices, faces, view=view, colours=colours)
    bar = figure.colorbar(mpl.cm.ScalarMappable(norm, "viridis"), ax=figure.axes, shrink=0.7)
    bar.set_label("largest force against a push (N)")
    return save(figure, dict(zip("xyz", pushed.T, strict=True)) | {"newtons": holding_newtons})


def _show(axes, vertices, faces, *, view, colours=None, points=None):
    """Draw a mesh, with the empty margins cropped."""
    image = render(vertices, faces, size=480, view=view, colours=colours, points=points)
    rows, columns = (np.flatnonzero(image[..., 3].any(axis=k)) for k in (1, 0))
    shown = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    axes.imshow(shown, interpolation="none")  # the same pixels in every file format
    axes.set_axis_off()
    axes.set_title("front" if list(view) == list(VIEW) else "back")


def quiver(fields, size=32, half=1.0):
    """Draw the force on the plane z = 0 of the unit frame: the paper's Fig. 2.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
        The first is exact; its outline is drawn in every panel.
    """
    axis = np.linspace(-half, half, size)
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    fine = np.linspace(-half, half, 240)
    outline = np.stack([*(g.ravel() for g in np.meshgrid(fine, fine)), np.zeros(240**2)], axis=1)
    distance = fields[0].answer(outline)[0].reshape(240, 240)
    figure = Figure(figsize=(4.6 * len(fields), 4.6))
    numbers = {"x": points[:, 0], "y": points[:, 1]}
    for index, field in enumerate(fields):
        axes = figure.add_subplot(1, len(fields), index + 1, aspect="equal")
        force = penalty_force(*field.answer(points))
        numbers |= {f"{field.name} F{axis}": force[:, k] for k, axis in enumerate("xyz")}
        inside = np.linalg.norm(force, axis=1) > 0
        axes.contour(fine, fine, distance, [0.0], colors="#888888", linewidths=0.8)
        axes.quiver(
            *points[inside, :2].T,
            *force[inside, :2].T,
            np.linalg.norm(force[inside], axis=1),
            angles="xy",
            scale=6,
            width=0.003,
            cmap="viridis",
        )
        axes.set(title=field.name, xlim=(-half, half), ylim=(-half, half), xlabel="x")
        if index == 0:
            axes.set_ylabel("y (unit frame)")
    pushed = np.any([column != 0 for name, column in numbers.items() if " F" in name], axis=0)
    return save(figure, {name: column[pushed] for name, column in numbers.items()})


def samples(artifact, limit=4000):
    """Draw the training points near z = 0, and the distribution of distances in each stratum.

    Parameters
    ----------
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``samples``.
    limit : int
        Approximate number of points shown on the plane.
    """
    points, distance, tied = (artifact.arrays[k] for k in ("points", "distance", "tied"))
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    plane, bars = figure.subplots(1, 2)
    near = np.flatnonzero(np.abs(points[:, 2]) < 0.01)
    near = near[:: max(1, len(near) // limit)]
    style = {"s": 3, "linewidths": 0, "rasterized": True}
    shown = plane.scatter(
        *points[near, :2].T, c=distance[near], cmap="coolwarm", vmin=-0.05, vmax=0.05, **style
    )
    ties = near[tied[near] > 0]
    plane.scatter(*points[ties, :2].T, color="black", **style)
    plane.set(aspect="equal", xlim=(-1, 1), ylim=(-1, 1), xlabel="x (unit frame)", ylabel="y")
    figure.colorbar(shown, ax=plane, label="signed distance", shrink=0.8, extend="both")
    edges = np.linspace(-0.15, 0.15, 121)
    numbers = {"distance from": edges[:-1], "to": edges[1:]}
    for name, (start, stop) in SamplesRecord.of(artifact).strata.items():
        if stop > start and name != "surface":
            part = np.clip(distance[start:stop], edges[0], edges[-1])
            counted = bars.hist(part, edges, histtype="step", label=f"{name} ({stop - start:,})")
            numbers[name] = counted[0].astype(int)
    bars.set(yscale="log", xlabel="signed distance (unit frame; the end bins contain the rest)")
    bars.set_ylabel("points")
    bars.legend(frameon=False, fontsize=7, title="stratum")
    return save(figure, numbers)


def force_along_path(forces, exact, specs, *, networks, window=300):
    """Draw the force over part of the path in spherical coordinates: the paper's Fig. 4."""
    part = slice(0, min(window, len(exact)))
    figure = Figure(figsize=(9.5, 6.4))
    panels = [figure.add_subplot(3, 1, k + 1) for k in range(3)]
    numbers = {}
    for spec in specs:
        if spec.kind == "exact":
            continue
        for axes, letter, values in zip(
            panels, "rθφ", _spherical(forces[spec.name][part]), strict=True
        ):
            numbers[f"{spec.name} {letter}"] = values
            axes.plot(values, lw=0.9, color=colour(spec, networks), label=spec.name, alpha=0.8)
    for axes, values, name in zip(
        panels, _spherical(exact[part]), ("r", "θ (°)", "φ (°)"), strict=True
    ):
        numbers[f"exact {name}"] = values
        axes.plot(values, lw=1.1, color="black", label="exact (GT)")
        axes.set_ylabel(name)
    panels[2].set_xlabel("sample of the trajectory")
    panels[0].legend(ncols=4, fontsize=7, frameon=False, loc="lower left", bbox_to_anchor=(0, 1))
    return save(figure, numbers)


def _spherical(force):
    r = np.linalg.norm(force, axis=1)
    safe = np.where(r > 0, r, np.nan)
    theta = np.degrees(np.arccos(np.clip(force[:, 2] / safe, -1, 1)))
    phi = np.degrees(np.arctan2(force[:, 1], force[:, 0]))
    return r, theta, np.where(r > 0, phi, np.nan)


def error_against_time(rows, specs, networks):
    """Draw the mean contact error against the time of a query in C, and against force changes.

    A line joins the usable fields that no other field beats in both quantities. Markers of
    unusable fields are hollow.
    """
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    by_name = {spec.name: spec for spec in specs}
    known = [r for r in rows if r["field"] in by_name and r["contact_mean"] != ""]
    floor = min((r["contact_mean"] for r in known if r["contact_mean"] > 0), default=1) / 5
    axes = [figure.add_subplot(1, 2, k + 1) for k in (0, 1)]
    for panel, key in zip(axes, ("native_p50_us", "jump_rms_newtons"), strict=True):
        shown, best = [row for row in known if row[key] != "" and row[key] > 0], []
        for row, unbeaten in zip(shown, pareto(shown, ("contact_mean", key)), strict=True):
            exact = row["contact_mean"] == 0  # a logarithmic axis cannot show zero
            x, y = row[key], floor if exact else row["contact_mean"]
            best += [(x, y)] if unbeaten else []
            look = colour(by_name[row["field"]], networks)
            fill = {} if may_be_used(row) else {"markerfacecolor": "none"}
            size = 7 if unbeaten else 5
            panel.loglog(x, y, "v" if exact else "o", color=look, ms=size, **fill)
            note = row["field"] + (" (error 0)" if exact else "")
            panel.annotate(note, (x, y), textcoords="offset points", xytext=(7, -3), fontsize=7)
        line = np.array(sorted(best, key=lambda at: (at[0], -at[1]))).reshape(-1, 2)
        panel.plot(*line.T, color="#888888", lw=1, zorder=0)
        panel.grid(True, which="major", alpha=0.25)
        panel.margins(x=0.3)
    axes[0].axvline(1000, color="#999999", ls=":", lw=1)
    axes[0].text(960, axes[0].get_ylim()[1], "1 kHz", ha="right", va="top", color="#777777")
    axes[0].set(
        xlabel="one query in C, median (µs)", ylabel="mean contact error (unit frame, k = 1)"
    )
    axes[1].set(xlabel="RMS change of force per 0.1 mm (N)")
    keys = ("field", "contact_mean", "native_p50_us", "bytes", "jump_rms_newtons", "front")
    return save(figure, {key: [row[key] for row in known] for key in keys})


def training_curves(models):
    """Draw the held-out force error of each network against its training steps."""
    figure = Figure(figsize=(6.4, 3.6))
    axes = figure.add_subplot()
    numbers = {}
    for index, (name, curve) in enumerate(models.items()):
        numbers |= {f"{name} step": curve[:, 0].astype(int), f"{name} error": curve[:, 2]}
        if len(curve):
            axes.semilogy(
                curve[:, 0], curve[:, 2], color=_LEARNED[index % len(_LEARNED)], label=name
            )
    axes.set(xlabel="step", ylabel="held-out force error")
    axes.legend(frameon=False)
    axes.grid(True, alpha=0.25)
    return save(figure, numbers)


def compute_histogram(compute, specs, networks, *, deadline):
    """Draw, for each exported field, the distribution of the compute time per tick."""
    figure = Figure(figsize=(6.4, 3.6))
    axes = figure.add_subplot()
    bins = np.geomspace(0.02, 2000, 150)
    numbers = {"microseconds from": bins[:-1], "to": bins[1:]}
    for spec in specs:
        if spec.name in compute:
            counted = axes.hist(
                np.clip(compute[spec.name] * 1e6, 0.02, 2000),
                bins,
                histtype="step",
                color=colour(spec, networks),
                label=spec.name,
                ls="--" if spec.form == "nearest" else "-",
            )
            numbers[spec.name] = counted[0].astype(int)
    axes.axvline(deadline * 1e6, color="#999999", ls=":", lw=1)
    axes.set(xscale="log", yscale="log", xlabel="compute time of a tick (µs)", ylabel="ticks")
    axes.legend(frameon=False, fontsize=7)
    return save(figure, numbers)

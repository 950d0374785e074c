"""Errors over several trajectories, with intervals: the paper's Table 4 as a statement."""

import numpy as np
from scipy import stats

from pandis.forces import penalty_force
from pandis.trajectories import trace

#: What the paper's claim is about: its own network against this field.
BASELINE = "trilinear-64"


def interval(values):
    """Return the half-width of the 95 % interval of a mean (Student's t)."""
    return float(stats.sem(values) * stats.t.ppf(0.975, len(values) - 1))


def several(first, surface, engine, options, progress):
    """Return the first trajectory and more of its kind.

    Parameters
    ----------
    first : tuple (points, distance, normal)
        Exact, unit frame.
    surface, engine
        See `pandis.trajectories.trace`.
    options : dict
        ``paths``: how many in all; ``trajectory``, ``seed``.
    progress : callable
        Makes a `pandis.stage.Progress`.
    """
    paths = [first]
    for index in range(1, options["paths"]):
        own = options["trajectory"] | {"seed": [options["seed"], 5, index]}
        more, _ = trace(surface, engine, own, progress)
        paths.append(tuple(more[key] for key in ("points", "distance", "normal")))
    return paths


def over_paths(fields, paths):
    """Compare all fields on several trajectories.

    Parameters
    ----------
    fields : list of pandis.fields.base.Field
    paths : list of tuple (points, distance, normal)
        At least two; exact, unit frame.

    Returns
    -------
    dict of str to dict
        By field: ``mean`` and ``interval`` of the paths' mean force errors (unit frame, k = 1);
        where `BASELINE` is among the fields, ``ratio`` and ``ratio_interval`` of the error to
        its on the same path.
    """
    means = {}
    for field in fields:
        forces = [penalty_force(*field.answer(path[0])) for path in paths]
        exact = [penalty_force(*path[1:]) for path in paths]
        off = [np.linalg.norm(f - e, axis=1).mean() for f, e in zip(forces, exact, strict=True)]
        means[field.name] = np.array(off)
    table = {}
    for name, found in means.items():
        table[name] = {"mean": float(found.mean()), "interval": interval(found)}
        if BASELINE in means:
            ratio = found / means[BASELINE]
            table[name] |= {"ratio": float(ratio.mean()), "ratio_interval": interval(ratio)}
    return table


def verdict(table, networks):
    """Say whether networks err less than the paper's best grid, where that was measured.

    Parameters
    ----------
    table : dict
        From `over_paths`.
    networks : list of str

    Returns
    -------
    str
        Empty where nothing can be said.
    """
    said = []
    for name in networks:
        row = table.get(name, {})
        if "ratio" not in row:
            continue
        low, high = (row["ratio"] + s * row["ratio_interval"] for s in (-1, 1))
        how = "less than" if high < 1 else "more than" if low > 1 else "about as much as"
        said.append(
            f"{name} errs {how} {BASELINE}: {row['ratio']:.2f} ± {row['ratio_interval']:.2f} times"
        )
    return "; ".join(said) + "." if said else ""

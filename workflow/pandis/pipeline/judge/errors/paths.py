"""Measures errors over several trajectories, and states the counterpart of the paper's Table 4."""

import json

import numpy as np
from scipy.special import stdtrit

from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.run.records.evaluation import PathsRecord

#: Grids with which networks are compared: the paper's best one, on the box around the surface as
#: in the paper, and on the cube that all other grids cover.
BASELINES = ("trilinear-box-64", "trilinear-64")


def interval(values):
    """Return the half-width of the 95 % interval of a mean (Student's t); 0 for equal values."""
    if min(values) == max(values):
        return 0.0  # else the mean's rounding would make it positive
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    return float(error * stdtrit(len(values) - 1, 0.975))


def spread(values, form):
    """Format results of training runs: mean and interval, or one or two values as they are.

    An interval from two values would say little: it is thirteen times as wide as their difference.
    """
    if len(values) < 3:
        return " and ".join(format(value, form) for value in values)
    return f"{np.mean(values):{form}} ± {interval(values):{form}}"


def repeats(models):
    """Return groups of networks that were trained in the same way with different seeds.

    Parameters
    ----------
    models : dict of str to pandis.pipeline.kinds.network.record.ModelRecord
        By recipe.

    Returns
    -------
    list of list of str
        In the order of ``models``.
    """
    groups = {}
    for name, model in models.items():
        key = json.dumps([model.options, model.steps, model.device], sort_keys=True)
        groups.setdefault(key, []).append(name)
    return list(groups.values())


def several(first, body, options, *, progress):
    """Return a list of the first trajectory and further ones traced in the same way.

    Parameters
    ----------
    first : tuple (points, distance, normal)
        Exact, unit frame.
    body : pandis.pipeline.geometry.body.Body
    options : pandis.pipeline.run.ask.tasks.EvaluateTask
    progress : pandis.base.progress.Progress
    """
    paths = [first]
    for index in range(1, options.paths):
        seed = [options.seed, 5, index]
        more, _ = trace(body, options.trajectory, seed, progress=progress)
        paths.append(tuple(more[key] for key in ("points", "distance", "normal")))
    return paths


def over_paths(fields, paths):
    """Compare all fields on several trajectories.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
    paths : list of tuple (points, distance, normal)
        At least two; exact, unit frame.

    Returns
    -------
    dict of str to pandis.pipeline.run.records.evaluation.PathsRecord
        By field: ``mean``, the mean of the paths' mean force errors (unit frame, k = 1);
        ``interval``, see `interval`; ``ratios``, the mean divided by that of each of `BASELINES`
        that is among the fields.
    """
    means = {}
    for field in fields:
        forces = [penalty_force(*field.answer(path[0])) for path in paths]
        exact = [penalty_force(*path[1:]) for path in paths]
        off = [np.linalg.norm(f - e, axis=1).mean() for f, e in zip(forces, exact, strict=True)]
        means[field.name] = np.array(off)
    return {
        name: PathsRecord(
            mean=float(errors.mean()),
            interval=interval(errors),
            ratios={b: float(errors.mean() / means[b].mean()) for b in BASELINES if b in means},
        )
        for name, errors in means.items()
    }


def verdict(table, models):
    """Return sentences that compare networks' errors with those of the paper's best grid.

    A network's error may vary by a third with the seed. So for one training run only the ratio is
    given; for several, a verdict from the confidence interval over the runs.

    Parameters
    ----------
    table : dict of str to pandis.pipeline.run.records.evaluation.PathsRecord
        By field.
    models : dict of str to pandis.pipeline.kinds.network.record.ModelRecord
        By name.

    Returns
    -------
    str
        Empty if there is no network or no such grid.
    """
    sentences = []
    for names in repeats({n: m for n, m in models.items() if n in table}):
        for baseline in BASELINES:
            ratios = [table[n].ratios[baseline] for n in names if baseline in table[n].ratios]
            if not ratios:
                continue
            what, mean = ", ".join(names), np.mean(ratios)
            if len(ratios) == 1:
                sentences.append(
                    f"{what} has {mean:.2f} times the error of {baseline} (one training)"
                )
                continue
            half = interval(ratios)
            how = (
                "a smaller error than" if mean + half < 1
                else "a larger error than" if mean - half > 1
                else "about the same error as"
            )  # fmt: skip
            sentences.append(
                f"{what} have {how} {baseline}: {mean:.2f} ± {half:.2f} times "
                f"({len(ratios)} trainings)"
            )
    return "; ".join(sentences) + "." if sentences else ""

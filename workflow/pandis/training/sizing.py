"""Networks of which the user names what they should achieve, not how large they are."""

from pandis.errors import PandisError
from pandis.training.trainer import Trainer

#: Widths that are tried, from fast to slow; bytes grow with their square.
WIDTHS = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)


def train(options, samples, strata, points, checkpoint, progress, log):
    """Train one network, or the smallest that meets the error that is asked for.

    Without ``force_error`` among the options it is one run.

    Parameters
    ----------
    options : dict
        See `pandis.run.recipes.PaperRecipe` and `ExactRecipe`; and ``seed``.
    samples, strata, checkpoint, log
        See `pandis.training.trainer.Trainer`.
    points : pandis.evaluation.points.Points or None
        What the error is measured on; only with ``force_error``.
    progress : callable
        Makes a `pandis.run.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``model-….zarr.zip``, except the frame.
    finish : callable
        Removes the checkpoints; to be called once the artifact is written.

    Raises
    ------
    PandisError
        No network meets the error, or a run diverged again and again.
    """
    if options.get("force_error") is None:
        trainer = Trainer(options, samples, strata, checkpoint, log)
        return *trainer.run(progress), trainer.finish
    limits = points.limits(options)
    found, tried, finish = narrowest(
        options, widths_up_to(options["width"]), samples, strata, checkpoint, progress, log,
        lambda trainer, arrays, attributes: points.measure(trainer.force_at, limits),
    )  # fmt: skip
    if found is None:
        finish()
        best = min(tried, key=lambda one: one["excess"])
        raise PandisError(
            f"train.{options['recipe']}: no network meets {points.told_limits(limits)}; of "
            f"{len(tried)}, up to {options['width']} units per layer, the nearest, of "
            f"{best['size']}, {best['why']}: ask for less, or give more steps or width"
        )
    arrays, attributes, measured = found
    keys = ("force_error", "tail", "missed")
    sizing = {
        "asked": {key: options[key] for key in keys},
        "tried": tried,
        "held_out_error": measured.figures["mean"],
        "held_out": measured.figures,
    }
    return arrays, attributes | {"sizing": sizing}, finish


def widths_up_to(width):
    """Return the widths that are tried, the last of them the one given."""
    return [w for w in WIDTHS if w < width] + [width]


def narrowest(options, widths, samples, strata, checkpoint, progress, log, judge):
    """Train networks, from the narrowest on, until one is taken.

    Each has the whole budget of steps: all before the one that is taken cost together about as
    much as that one does.

    Parameters
    ----------
    options, samples, strata, checkpoint, progress, log
        As for `train`.
    widths : list of int
    judge : callable
        Returns a `pandis.evaluation.points.Measured` for trainer, arrays and attributes: taken if
        its ``why`` is empty.

    Returns
    -------
    found : tuple (arrays, attributes, measured), or None
        What was taken.
    tried : list of dict
        ``size``, ``bytes``, ``force_error``, ``excess`` and ``why`` of every network.
    finish : callable
        Removes the checkpoints of all.
    """
    tried, finish = [], lambda: None
    for width in widths:
        own = checkpoint.with_name(f"{checkpoint.stem}.{width}.pt")
        trainer = Trainer(options | {"width": width}, samples, strata, own, log)
        arrays, attributes = trainer.run(progress)
        trainer.keep()
        finish = trainer.finish
        measured = judge(trainer, arrays, attributes)
        size = sum(arrays[key].nbytes for key in arrays if key != "curve")
        error = measured.figures["mean"]
        tried.append({"size": width, "bytes": size, "force_error": error,
                      "excess": measured.excess, "why": measured.why})  # fmt: skip
        log(f"network of {width} units per layer: {measured.why or 'meets what is asked'}")
        if not measured.why:
            return (arrays, attributes, measured), tried, finish
    return None, tried, finish

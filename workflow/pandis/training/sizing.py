"""Networks of which the user names what they should achieve, not how large they are."""

from pandis.errors import PandisError
from pandis.sampling import held_out
from pandis.training.trainer import Trainer

#: Widths that are tried, from fast to slow; bytes grow with their square.
WIDTHS = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)


def train(options, samples, strata, checkpoint, progress, log):
    """Train one network, or the smallest that errs as little as is asked for.

    Without ``force_error`` among the options it is one run. With it, networks from the
    narrowest to ``width`` are trained, each with the whole budget, until one meets the error:
    all before it together cost about as much as that one does. What is measured is what
    `pandis.fields.sizing` measures of grids.

    Parameters
    ----------
    options : dict
        See `pandis.config.PaperRecipe` and `ExactRecipe`; and ``seed``.
    samples, strata, checkpoint, log
        See `pandis.training.trainer.Trainer`.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``model-….zarr.zip``, but for the frame.
    finish : callable
        Removes the checkpoints; to be called once the artifact is written.

    Raises
    ------
    PandisError
        No network meets the error, or a run diverged again and again.
    """
    wanted = options.get("force_error")
    if wanted is None:
        trainer = Trainer(options, samples, strata, checkpoint, log)
        return *trainer.run(progress), trainer.finish
    exact, tried = held_out(strata.surface, strata.engine, options["seed"]), []
    for width in [w for w in WIDTHS if w < options["width"]] + [options["width"]]:
        own = checkpoint.with_name(f"{checkpoint.stem}.{width}.pt")
        trainer = Trainer(options | {"width": width}, samples, strata, own, log)
        arrays, attributes = trainer.run(progress)
        trainer.keep()
        error = trainer.force_error(*exact)["mean"]
        size = sum(arrays[key].nbytes for key in arrays if key != "curve")
        tried.append({"size": width, "bytes": size, "force_error": error})
        log(f"network of {width} units per layer: mean force error {error:.3e}")
        if error <= wanted:
            sizing = {"asked": {"force_error": wanted}, "tried": tried, "held_out_error": error}
            return arrays, attributes | {"sizing": sizing}, trainer.finish
    trainer.finish()
    best = min(tried, key=lambda one: one["force_error"])
    raise PandisError(
        f"train.{options['recipe']}: no network meets the mean force error of {wanted:g} asked "
        f"for; of {len(tried)}, up to {options['width']} units per layer, the one of "
        f"{best['size']} has the least, {best['force_error']:.3g}: ask for less, or give more "
        "steps or width"
    )

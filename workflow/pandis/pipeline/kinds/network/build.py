"""Trains one network, or several from narrow to wide until one meets the recipe's limits."""

from typing import NamedTuple

from pandis.base.errors import PandisError
from pandis.base.physical import Scale
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.kinds.network.training.batches import TrainingPoints
from pandis.pipeline.kinds.network.training.trainer import Trainer

#: Widths to try, from fast to slow; bytes grow with the square of the width.
WIDTHS = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)


class Tried(NamedTuple):
    """A trained network: units per layer, bytes, errors, and the reason for its rejection."""

    size: int
    bytes: int
    force_error: float
    excess: float
    why: str


def build(job):
    """Train one network, and write ``model-{recipe}.zarr.zip``.

    Raises
    ------
    PandisError
        See `train`.
    """
    mesh, samples = job.read("mesh", "mesh"), job.read("samples", "samples")
    body, task = Body.open(mesh), job.options
    points = Points(body, Scale.of(task), task.seed)
    arrays, attributes, finish = train(
        task, TrainingPoints(samples, Strata.of(body, samples)), points, context=job.context()
    )
    job.write("model", arrays, attributes | body.frame.attributes())
    finish()


def train(task, shown, points, *, context):
    """Train one network, or the narrowest that meets the recipe's limits.

    Without ``force_error`` in the recipe, one network is trained.

    Parameters
    ----------
    task : pandis.pipeline.kinds.network.spec.TrainTask
    shown : pandis.pipeline.kinds.network.training.batches.TrainingPoints
    points : pandis.pipeline.geometry.points.Points
        Points on which the force error is measured.
    context : pandis.base.progress.Context

    Returns
    -------
    arrays, attributes : dict
        As stored in ``model-….zarr.zip``, except the frame.
    finish : callable
        Removes the checkpoints; to be called once the artifact is written.

    Raises
    ------
    PandisError
        No network meets the limits, or a run diverged repeatedly.
    """
    if task.recipe.loss == "paper" or task.recipe.force_error is None:
        trainer = Trainer(task, shown, context)
        return *trainer.run(), trainer.finish
    recipe = task.recipe
    limits = points.limits(recipe)
    network, tried, finish = narrowest(
        task, widths_up_to(recipe.width), shown, context=context,
        judge=lambda trainer, arrays, attributes: points.measure(trainer.force_at, limits),
    )  # fmt: skip
    if network is None:
        finish()
        best = min(tried, key=lambda one: one.excess)
        raise PandisError(
            f"train.{task.name}: no network meets {points.describe_limits(limits)}; the closest "
            f"of {len(tried)} networks (up to {recipe.width} units per layer), with {best.size} "
            f"units, {best.why}: relax the limits, or allow more steps or width"
        )
    arrays, attributes, measured = network
    sizing = {
        "asked": recipe.model_dump(include={"force_error", "tail", "missed"}),
        "tried": [one._asdict() for one in tried],
        "held_out_error": measured.figures["mean"],
        "held_out": measured.figures,
    }
    return arrays, attributes | {"sizing": sizing}, finish


def widths_up_to(width):
    """Return the widths to try, ending with the given one."""
    return [w for w in WIDTHS if w < width] + [width]


def narrowest(task, widths, shown, *, context, judge):
    """Train networks, from narrow to wide, until one is accepted.

    Each is trained for the full budget of steps. All networks before the accepted one together
    cost about as much as the accepted one alone.

    Parameters
    ----------
    task, shown, context
        As for `train`.
    widths : list of int
    judge : callable
        Takes trainer, arrays and attributes; returns a
        `pandis.pipeline.geometry.points.Measured`. The network is accepted if ``why`` is empty.

    Returns
    -------
    network : tuple (arrays, attributes, measured), or None
        The accepted network.
    tried : list of Tried
    finish : callable
        Removes the checkpoints of all networks.
    """
    tried, finish, checkpoint = [], lambda: None, context.checkpoint
    for width in widths:
        state = checkpoint.with_name(f"{checkpoint.stem}.{width}.pt")
        recipe = task.recipe.model_copy(update={"width": width})
        trainer = Trainer(
            task.model_copy(update={"recipe": recipe}), shown, context._replace(checkpoint=state)
        )
        arrays, attributes = trainer.run()
        trainer.keep()
        finish = trainer.finish
        measured = judge(trainer, arrays, attributes)
        size = sum(arrays[key].nbytes for key in arrays if key != "curve")
        error = measured.figures["mean"]
        tried.append(Tried(width, size, error, measured.excess, measured.why))
        context.log(f"network of {width} units per layer: {measured.why or 'meets the limits'}")
        if not measured.why:
            return (arrays, attributes, measured), tried, finish
    return None, tried, finish

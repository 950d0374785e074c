"""Tries networks for `fields: auto`, and makes those whose queries are timed."""

import torch

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.points import Measured
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.build import narrowest, widths_up_to
from pandis.pipeline.kinds.network.file import network_bytes
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.spec import KIND, TrainTask
from pandis.pipeline.kinds.network.training.batches import TrainingPoints
from pandis.pipeline.kinds.network.training.network import Siren, named_arrays
from pandis.pipeline.kinds.sizing import Outcome
from pandis.pipeline.run.job.artifact import Artifact

#: Units per layer of the networks in the table of query times.
_WIDTHS = (16, 64, 128, 256, 512)
#: Options that these networks share.
_BASE, _DEPTH, _OMEGA = 16, 4, 30.0


def choose(chooser):
    """Try networks from narrow to wide, each fully trained: see `pandis.pipeline.kinds`."""
    chooser.say_least()
    options, points = chooser.options, chooser.points
    name, recipe = options.name, options.recipe
    sizes = {w: _bytes(recipe, w, options.weight_bits) for w in widths_up_to(recipe.width)}
    fit = chooser.fitting(KIND.name, sizes, name, layers=recipe.depth)
    if not fit:
        return None
    # use another seed: splines that were tried have used the points drawn with this job's seed
    strata = Strata(points.body, options.samples, options.seed + 1)
    drawn = strata.arrays(chooser.progress)
    samples = Artifact("samples", drawn, strata.attributes())
    task = TrainTask(kind=KIND.name, name=name, recipe=recipe, seed=options.seed)

    def judge(trainer, arrays, attributes):
        measured = points.measure(trainer.force_at, chooser.limits)
        if measured.why:
            return measured
        frame = chooser.body.frame.attributes()
        artifact = Artifact("model", arrays, attributes | frame)
        return chooser.proved(SirenField(name, artifact), measured)

    try:
        network, tried, finish = narrowest(
            task,
            fit,
            TrainingPoints(samples, strata),
            context=chooser.context,
            judge=judge,
        )
    except PandisError as error:
        chooser.skip(name, str(error))
        return None
    if network is None:
        best = min(tried, key=lambda one: one.excess)
        chooser.skip(name, f"of {best.size} units, {best.why}")
        chooser.note(f"{name} of {best.size} units", Measured({}, best.why, best.excess))
        finish()
        return None
    arrays, attributes, measured = network
    width = attributes["architecture"]["width"]
    seconds = chooser.time(KIND.name, width, layers=recipe.depth)
    choice = chooser.choice(name, sizes[width], measured, seconds=seconds)
    return Outcome(arrays, attributes, choice, finish)


def _bytes(recipe, width, weight_bits):
    """Return the size of a network and its base in bytes."""
    outputs = 1 if recipe.direction == "gradient" else 4
    return network_bytes(width, recipe.depth, outputs, base=recipe.base, weight_bits=weight_bits)


def timed(torus):
    """See `pandis.pipeline.kinds`."""
    base = fit_base(torus.points.body.distance, _BASE).coefficients
    for width in _WIDTHS:
        yield KIND.name, width, lambda width=width: _untrained(torus.points.body.frame, base, width)


def _untrained(frame, base, width):
    network = Siren(width, _DEPTH, _OMEGA, outputs=1, generator=torch.Generator().manual_seed(0))
    arrays = named_arrays(list(network.parameters())) | {"base": base}
    shape = {"width": width, "depth": _DEPTH, "omega": _OMEGA, "outputs": 1}
    attributes = {"architecture": shape, **frame.attributes()}
    return SirenField(KIND.name, Artifact("model", arrays, attributes))

"""Names and options of networks."""

from typing import Annotated

from pydantic import Field

from pandis.pipeline.run.ask.kind import BuildTask, FieldSpec, Kind
from pandis.pipeline.run.ask.recipes import ExactRecipe, PaperRecipe, budgeted
from pandis.pipeline.run.ask.targets import DeviceOptions

_TRAINING = "pandis.pipeline.kinds.network.training"
#: Modules that run only for one kind of recipe, although the trainer imports all of them.
_LOSSES = {"paper": f"{_TRAINING}.paper_loss", "exact": f"{_TRAINING}.exact_loss"}
#: Modules that run only when a GPU trains.
_ON_GPUS = (f"{_TRAINING}.labels", "pandis.engine.cuda.steps")


class TrainTask(DeviceOptions, BuildTask):
    """Train one network. Error limits in newtons refer to the device's scale."""

    name: str
    recipe: Annotated[PaperRecipe | ExactRecipe, Field(discriminator="loss")]
    seed: int


class Network(Kind):
    """Sine networks, each named after its recipe under `train`."""

    name = "network"
    help = "or any recipe under `train`"
    forms = (name,)
    chosen = True
    growth = 1.0
    task = TrainTask

    def parse_recipe(self, name):
        """See `Kind.parse_recipe`."""
        return FieldSpec(name, self.name, self.name, f"model-{name}", exports=("onnx", "pt2"))

    def sized_options(self, job, spec):
        """See `Kind.sized_options`."""
        recipe = budgeted(job.entry.train[spec.name])
        searched = recipe if recipe.loss == "exact" else None
        device = dict(job.scale_of(searched))
        return TrainTask(kind=self.name, name=spec.name, recipe=recipe, seed=job.seed, **device)

    def unused(self, options):
        """Return the other loss's module, and those for GPUs if a CPU trains: see `Kind.unused`."""
        recipe = options.get("recipe", {})
        losses = [m for loss, m in _LOSSES.items() if recipe.get("loss", loss) != loss]
        on_cpu = recipe.get("device", "cpu") == "cpu"
        return [*losses, *(_ON_GPUS if on_cpu else ())]

    def work(self, size, layers=4):
        """Return the approximate number of multiplications per query: one per weight."""
        return (layers - 1) * size**2 + 4 * size

    def stream(self, spec):
        """See `Kind.stream`."""
        return "train", spec.name


KIND = Network()

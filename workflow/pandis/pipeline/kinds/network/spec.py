"""Names and options of networks."""

from typing import Annotated

from pydantic import Field

from pandis.pipeline.run.ask.kind import BuildTask, FieldSpec, Kind
from pandis.pipeline.run.ask.recipes import ExactRecipe, PaperRecipe, budgeted
from pandis.pipeline.run.ask.targets import DeviceOptions

_TRAINING = "pandis.pipeline.kinds.network.training"
#: Modules that only one kind of recipe runs, though the trainer imports them all.
_LOSSES = {"paper": f"{_TRAINING}.paper_loss", "exact": f"{_TRAINING}.exact_loss"}
#: Modules that only a training on a GPU runs.
_ON_GPUS = (f"{_TRAINING}.labels", "pandis.engine.cuda.steps")


class TrainTask(DeviceOptions, BuildTask):
    """Train one network. Errors that are asked for in newtons are at the device's scale."""

    name: str
    recipe: Annotated[PaperRecipe | ExactRecipe, Field(discriminator="loss")]
    seed: int


class Network(Kind):
    """Sine networks: each recipe under `train` names one."""

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
        """See `Kind.unused`: the other loss, and modules for GPUs if a CPU trains."""
        recipe = options.get("recipe", {})
        losses = [m for loss, m in _LOSSES.items() if recipe.get("loss", loss) != loss]
        on_cpu = recipe.get("device", "cpu") == "cpu"
        return [*losses, *(_ON_GPUS if on_cpu else ())]

    def work(self, size, layers=4):
        """Return about how many products a query makes: one per weight."""
        return (layers - 1) * size**2 + 4 * size

    def stream(self, spec):
        """See `Kind.stream`."""
        return "train", spec.name


KIND = Network()

"""What each stage is asked: the models of `job.options`.

The plan fills one for every job out of the configuration, Snakemake carries it as plain values, and
the stage's script names its model and gets it back. A model holds what makes its stage stale when
it changes, and nothing else. Like those of the configuration it names and checks values and does
nothing with them, so that it is no part of a stage's code.
"""

from typing import Annotated, Literal

from pydantic import Field

from pandis.pipeline.run.ask.contacts import ContactOptions, SurfaceOptions
from pandis.pipeline.run.ask.options import (
    EvaluationOptions,
    HardwareOptions,
    MeshOptions,
    NativeOptions,
    SampleOptions,
    StressOptions,
    TimingOptions,
    TrajectoryOptions,
)
from pandis.pipeline.run.ask.recipes import ExactRecipe, PaperRecipe
from pandis.pipeline.run.ask.targets import BudgetOptions, DeviceOptions
from pandis.pipeline.run.ask.values import Options


class FetchTask(Options):
    """Download the source of a mesh."""

    url: str
    sha256: str


class MeshTask(MeshOptions):
    """Read and repair a mesh."""

    source: str
    sha256: str | None
    seed: int


class RefuseTask(Options):
    """Say why a mesh cannot be built."""

    why: str


class SampleTask(SampleOptions):
    """Draw and label the points that a mesh is learnt from."""

    seed: int


class ChooseTask(DeviceOptions):
    """Build the cheapest field that meets the budget; ``name`` is the recipe's."""

    budget: BudgetOptions
    name: str
    recipe: Annotated[PaperRecipe | ExactRecipe, Field(discriminator="loss")]
    samples: SampleOptions
    stress: StressOptions
    weight_bits: Literal[16, 32]
    band: tuple[float, float]
    seed: int


class ExportTask(Options):
    """Export one field as a graph, a program or an image."""

    field: str


class ExportNativeTask(NativeOptions):
    """Export one field for ``pandis.h``."""

    field: str


class ExportMeshTask(Options):
    """Write the repaired mesh for other programs: nothing is asked."""


class ExportMjcfTask(Options):
    """Write a model for MuJoCo with the exported fields of a mesh; its longest side, m."""

    size: float
    fields: list[str]


class ExportNewtonTask(Options):
    """Write a mesh's distances for Newton's cache; its longest side, m."""

    size: float


class ExportPageTask(DeviceOptions):
    """Put the exported fields of a mesh on a page; at first with the device's scale."""

    fields: list[str]


class ExportVdbTask(Options):
    """Write the exported fields of a mesh as volumes."""

    fields: list[str]


class TrajectoryTask(TrajectoryOptions):
    """Trace the probe's path."""

    seed: int


class EvaluateTask(EvaluationOptions, DeviceOptions):
    """Compare the fields with the exact one; with several paths, of this kind of trajectory."""

    fields: list[str]
    trajectory: TrajectoryOptions | None
    seed: int


class StressTask(StressOptions, DeviceOptions):
    """Put the fields under a device and a hand, and, if asked for, a proxy between them."""

    fields: list[str]
    proxies: bool
    seed: int


class TimingTask(TimingOptions):
    """Time the fields; some are asked in Python."""

    in_python: list[str]


class HandOptions(Options):
    """The hand that holds a simulated device: N/m, Ns/m, N, and ticks that a force comes late."""

    stiffness: float
    damping: float
    press: float
    delay: int


class ValidateTask(HardwareOptions, DeviceOptions):
    """Run the exported fields at the servo rate."""

    fields: list[str]
    hand: HandOptions
    contact: ContactOptions
    seed: int


class PlacedObject(Options):
    """An object of a scene: metres, degrees about the axis, N/m.

    ``beside`` is a field of the same mesh that says which material a place is made of.
    """

    name: str
    mesh: str
    field: str
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    size: float
    stiffness: float
    contact: SurfaceOptions = Field(default_factory=SurfaceOptions)
    beside: str | None = None


class SceneTask(Options):
    """Walk through a scene; m/s."""

    objects: list[PlacedObject]
    ticks: int
    speed: float
    radius: float = 0.0


class SummaryTask(Options):
    """Collect the rows, or the page, of all meshes: their fields by name."""

    fields: dict[str, list[str]]


class CalibrateTask(Options):
    """Time every kind of field; the table's place."""

    table: str


class VerifyTask(Options):
    """Check the whole chain of results against these files, if no object store has the results."""

    configfiles: list[str]
    store: str = ""

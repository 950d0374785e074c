"""The options of each stage: the models of `job.options`.

The plan creates one model per job from the configuration. Snakemake passes its values on as plain
data, from which the stage's script recreates the model. A model contains exactly the values that
make its stage stale when they change. Like the models of the configuration, it only names and
checks values, so it does not count as a part of a stage's code.
"""

from typing import Annotated, Any, Literal

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
    """Report why a mesh cannot be built."""

    why: str


class SampleTask(SampleOptions):
    """Draw and label the training points of a mesh."""

    seed: int


class ChooseTask(DeviceOptions):
    """Build the cheapest field that meets the budget; ``name`` is the name of ``recipe``."""

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
    """Write the repaired mesh for other programs; this stage has no options."""


class ExportMjcfTask(Options):
    """Write a MuJoCo model with the exported fields of a mesh; ``size`` is its longest side, m."""

    size: float
    fields: list[str]


class ExportNewtonTask(Options):
    """Write a mesh's distances for Newton's cache; ``size`` is its longest side, m."""

    size: float


class ExportPageTask(DeviceOptions):
    """Put the exported fields of a mesh on a page, initially at the device's scale."""

    fields: list[str]


class ExportVdbTask(Options):
    """Write the exported fields of a mesh as volumes."""

    fields: list[str]


class TrajectoryTask(TrajectoryOptions):
    """Trace the probe's path."""

    seed: int


class EvaluateTask(EvaluationOptions, DeviceOptions):
    """Compare the fields with the exact one; ``trajectory`` is None if there is only one path."""

    fields: list[str]
    trajectory: TrajectoryOptions | None
    seed: int


class StressTask(StressOptions, DeviceOptions):
    """Test the fields with a simulated device and hand; with ``proxies``, also through a proxy."""

    fields: list[str]
    proxies: bool
    seed: int


class TimingTask(TimingOptions):
    """Time all fields; those in ``in_python`` are timed from Python."""

    in_python: list[str]


class HandOptions(Options):
    """The hand that holds a simulated device (N/m, Ns/m, N), and the force's delay in ticks."""

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
    """An object of a scene; lengths in m, rotation vector in degrees, stiffness in N/m.

    ``beside`` is a field of the same mesh whose file contains the materials, if one is needed.
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
    """Walk through a scene; ``speed`` in m/s, ``radius`` in m."""

    objects: list[PlacedObject]
    ticks: int
    speed: float
    radius: float = 0.0


class SummaryTask(Options):
    """Collect the rows or make the page of all meshes; ``fields`` lists the fields of each mesh."""

    fields: dict[str, list[str]]


class CalibrateTask(Options):
    """Time every kind of field; ``table`` is the path of the table."""

    table: str


class VerifyTask(Options):
    """Check the whole chain of results against ``configfiles``; refused if there is a ``store``."""

    configfiles: list[str]
    store: str = ""


class ShardTask(Options):
    """Label the meshes of one shard of a data set, and build fields of each.

    ``builds`` has the options for building each field, but for its seed, and ``export`` those for
    its file. ``members`` is a digest of the list of meshes.
    """

    source: str
    table: str | None
    override: dict[str, dict[str, dict[str, Any]]]
    mesh: MeshOptions
    samples: SampleOptions
    builds: dict[str, dict[str, Any]]
    export: NativeOptions
    seed: int
    chunk: int
    seconds: float
    memory_gb: float
    shard: int
    shards: int
    members: str


class DatasetTask(Options):
    """Write the index and the card of a data set that is divided into ``shards`` files."""

    dataset: str
    source: str
    shards: int

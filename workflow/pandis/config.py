"""What a user may ask for: the options of every stage, checked before anything runs.

The models below are the single source of the option names, their defaults and
their meaning: ``workflow/schemas/config.schema.json`` and the tables of
``config/README.md`` are generated from them (``make docs``).

This module stands on the ground floor: it runs at every planning of the
workflow and imports neither torch nor trimesh.
"""

import difflib
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from pandis.budget import AMOUNT, amount
from pandis.catalogue import (
    AUTO,
    GRID_FIELDS,
    MESH_NAME,
    PLANE_FIELDS,
    PROXY,
    RESERVED_NAMES,
    is_builtin_field,
    parse_field,
)
from pandis.errors import PandisError

Angle = Annotated[float, Field(ge=-360, le=360)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


def _amount(value):
    """Check an amount of force, and keep it as the user wrote it."""
    amount(value)
    return value


_AMOUNTS = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string", "pattern": f"^{AMOUNT}$"},
    ]
}
Force = Annotated[float | str, BeforeValidator(_amount), WithJsonSchema(_AMOUNTS)]
Missed = Annotated[float, Field(gt=0, le=0.005)]
Place = Annotated[float, Field(ge=-100, le=100)]


class Options(BaseModel):
    """Base of all options: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", validate_default=False)


class DeviceOptions(Options):
    """Physical scale: how large and how stiff the object is under the device."""

    size: Positive = Field(0.10, description="metres of the mesh's longest side in the workspace")
    stiffness: Positive = Field(400.0, description="stiffness k of the surface in N/m")


class MeshOptions(Options):
    """Loading and repair. What each rung does, and to which meshes: docs/repair.md."""

    unit: str = Field(
        "unknown",
        pattern=r"^[A-Za-zµ]{1,12}$",
        description="what one mesh unit is (`mm`, `m`, …): recorded, nothing is scaled by it; "
        "glTF and 3MF files say it themselves",
    )
    weld: float = Field(
        1e-8,
        ge=0,
        le=1e-3,
        description="vertices closer than this share of the diagonal become one; used only where "
        "exact welding leaves the mesh open; 0: never",
    )
    rungs: list[Literal["clean", "union", "fill", "meshfix", "remesh", "wrap"]] = Field(
        ["clean", "union", "fill", "meshfix", "remesh", "wrap"],
        description="the repairs that may be tried, in this order, on a mesh that is not valid; "
        "leave out what you do not want",
    )
    small_hole: float = Field(
        0.5,
        ge=0,
        le=100,
        description="a hole is small, and filled, if its rim is at most this share of its "
        "component's diagonal",
    )
    max_hole_edges: int = Field(500, ge=0, description="a hole with more edges is not small")
    open: Literal["refuse", "cap", "thicken"] = Field(
        "refuse",
        description="a surface with holes that are not small: refuse it, cap the holes all the "
        "same, or make it a wall of `thickness`",
    )
    thickness: Positive = Field(
        0.01, le=0.2, description="thickness of that wall, as a share of the diagonal"
    )
    nested: Literal["cavity", "solid"] = Field(
        "cavity",
        description="what a component wholly inside another bounds: a cavity (and inside that an "
        "island, by parity), or matter, so that only the outer surface remains",
    )
    deviation_p99: float = Field(
        0.005,
        ge=0,
        description="a repair is kept only if 99 % of the surface, both ways, moves no farther "
        "than this share of the diagonal (caps of holes and walls inside the solid not counted)",
    )
    deviation_max: float = Field(0.03, ge=0, description="the same for all of the surface")
    rung_seconds: Positive = Field(240.0, description="time limit of each rung")
    rung_memory_gb: Positive = Field(3.0, description="memory limit of each rung")
    reader_seconds: Positive = Field(120.0, description="time limit of each reader")
    reader_memory_gb: Positive = Field(3.0, description="memory limit of each reader")


class SampleOptions(Options):
    """Training and held-out points. Lengths are in the unit frame (longest side 1.8).

    Recipes on exact distances draw points of their own, in the same proportions.
    """

    surface: Count = Field(50_000, description="points on the surface")
    offsets: int = Field(
        100_000, ge=0, description="points off the surface along the normal, over all scales"
    )
    scales: Annotated[list[Positive], Field(min_length=1)] = Field(
        [0.003, 0.01, 0.03], description="standard deviations of the offsets"
    )
    shallow: int = Field(350_000, ge=0, description="points within 0.0115 below the surface")
    penetration: int = Field(250_000, ge=0, description="points within `depth` below it")
    bent: int = Field(
        250_000,
        ge=0,
        description="points below the surface, up to eight times denser where it bends: the "
        "angles between neighbouring faces, per 0.05 of length",
    )
    depth: Positive = Field(0.045, description="largest depth below the surface")
    core: int = Field(
        50_000,
        ge=0,
        description="points deeper than `depth` along the normal, up to 1: behind thin parts they "
        "come out again",
    )
    box: int = Field(50_000, ge=0, description="points uniform in the box [-1, 1]³")
    held_out: Annotated[int, Field(ge=100)] = Field(
        20_000, description="points never trained on: half at most 0.01 deep, half at most 0.04"
    )


_MUON = (
    "Muon's largest step size, for the matrices between sine layers (of ω0·W); null: Adam moves "
    "them too"
)
_SCHEDULE = (
    "constant step sizes, or sizes that rise during the warm-up and then fall to zero along half a "
    "cosine"
)


class Recipe(Options):
    """What both recipes of the sine network share."""

    width: Annotated[int, Field(ge=1, le=1024)] = Field(256, description="units of each sine layer")
    depth: Annotated[int, Field(ge=1, le=16)] = Field(
        4, description="number of sine layers; 4 is the paper's 800 KB"
    )
    steps: Count | None = Field(None, description="budget in optimiser steps: bytes reproduce")
    seconds: Positive | None = Field(
        None,
        description="budget in seconds instead: the steps reached are recorded, "
        "and the result does not reproduce",
    )
    direction: Literal["output", "gradient"] = Field(
        "output",
        description="where the normal comes from: three outputs of their own, as in the paper, or "
        "the gradient of the distance, which makes the force all but conservative",
    )
    base: Annotated[int, Field(ge=4, le=64)] | None = Field(
        None,
        description="cells per axis of a tricubic spline of the distance over the whole box, to "
        "which the network adds what it lacks; null: the network alone",
    )
    matrix_rate: Positive | None = Field(None, description=_MUON)
    schedule: Literal["constant", "cosine"] = Field("constant", description=_SCHEDULE)
    warmup: float = Field(
        0.02,
        ge=0,
        lt=1,
        description="with cosine: share of the budget during which they rise",
    )
    threads: Count = Field(
        1,
        description="CPU threads; a part of the result's identity. With one, `-j2` trains two "
        "networks at once; more pay only where there are more cores than networks",
    )
    device: Literal["cpu", "cuda", "auto"] = Field(
        "cpu", description="where to train; auto takes CUDA if found and records which"
    )

    @model_validator(mode="after")
    def _one_budget(self):
        if self.steps is not None and self.seconds is not None:
            raise ValueError("a budget is in steps or in seconds, not both: remove one")
        return self


class PaperRecipe(Recipe):
    """The paper's recipe: seven-term loss on surface and box points, no exact distances."""

    loss: Literal["paper"] = "paper"
    omega: Positive = Field(30.0, description="ω0, the factor inside every sine")
    points: Literal["area", "vertices"] = Field(
        "area",
        description="points on the surface: spread evenly by area, with the normals of their "
        "faces, as many as `samples.surface` says; or the vertices, with their own normals, as in "
        "the paper",
    )
    batch: Count = Field(1400, description="points on the surface per step; as many again off it")
    weighting: Literal["subset", "batch"] = Field(
        "subset",
        description="a term that holds for one half of the points is a mean over that half; or "
        "over the whole batch, as in SIREN's code, which halves its weight beside the others: as "
        "good in short trainings, and better in long ones",
    )
    learning_rate: Positive = Field(1e-4, description="Adam's largest step size")
    clip: Positive | None = Field(1.0, description="largest norm of the gradient; null: no limit")
    weights: Annotated[list[float], Field(min_length=7, max_length=7)] = Field(
        [50.0, 100.0, 3000.0, 100.0, 50.0, 100.0, 100.0],
        description="weights of the loss terms, in the order printed in the paper",
    )
    alpha: Positive = Field(100.0, description="a in exp(-a·|Φ|)")
    stop_gradient: bool = Field(True, description="Ψ·∇Φ trains Ψ only, not Φ (the paper: unsaid)")


class ExactRecipe(Recipe):
    """Regression on the exact distance and normal: the default."""

    loss: Literal["exact"] = "exact"
    direction: Literal["output", "gradient"] = Field(
        "gradient",
        description="where the normal comes from: the gradient of the distance, which makes the "
        "force all but conservative and the error smaller, or three outputs of their own, which "
        "shortens a query",
    )
    width: Annotated[int, Field(ge=1, le=1024)] = Field(
        248, description="units of each sine layer; 248 and the base are as large as the paper's"
    )
    base: Annotated[int, Field(ge=4, le=64)] | None = Field(
        16,
        description="cells per axis of a tricubic spline of the distance over the whole box, to "
        "which the network adds what it lacks; null: the network alone, which makes contacts in "
        "free space",
    )
    omega: Positive | None = Field(
        None,
        description="ω0, the factor inside every sine: the finer the shape, the larger; null: "
        "80·√(width / 256)",
    )
    force_error: Force | None = Field(
        None,
        description="train the narrowest network, of widths up to `width`, with this mean force "
        "error on the contact set: written as in `budget`",
    )
    tail: Force | None = Field(
        None, description="with `force_error`: its 99th percentile; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="with `force_error`: share of the surface that may lack the force"
    )
    batch: Count = Field(4096, description="points per step, each shown once")
    learning_rate: Positive = Field(
        2e-4, description="Adam's largest step size; first and last layer, biases"
    )
    matrix_rate: Positive | None = Field(0.05, description=_MUON)
    schedule: Literal["constant", "cosine"] = Field("cosine", description=_SCHEDULE)
    clip: Positive | None = Field(None, description="largest norm of the gradient; null: no limit")
    near: Positive = Field(
        0.02, description="a point at distance d weighs near / (near + |d|) (unit frame)"
    )
    far: float = Field(
        0.3,
        ge=0,
        le=1,
        description="least weight of a point's distance, however far it is (a third of it for its "
        "normal)",
    )
    normal_weight: Positive = Field(0.05, description="weight of the normal's error in the loss")


class GridTarget(Options):
    """What a grid named `…-auto` should achieve."""

    force_error: Force | None = Field(
        None, description="mean force error on the contact set: written as in `budget`"
    )
    tail: Force | None = Field(
        None, description="with `force_error`: its 99th percentile; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="with `force_error`: share of the surface that may lack the force"
    )
    bytes: Count | None = Field(None, description="bytes that a program holds in memory")

    @model_validator(mode="after")
    def _one_target(self):
        if (self.force_error is None) == (self.bytes is None):
            raise ValueError("name one of force_error and bytes")
        return self


#: Targets that hold where the user names none.
TARGETS = {"spline": {"bytes": 800_000}}


class BudgetOptions(Options):
    """What the field named `auto` should achieve: the cheapest to build that does is built.

    Errors are those of the contact set: points down to 0.04 below the surface, or to nine tenths of
    the largest ball inside that touches it there.
    """

    force_error: Force | None = Field(
        None,
        description="mean force error: a number (unit frame, k = 1), or a text such as `20 mN` (at "
        "`device`) or `5 %` (of the mean force)",
    )
    tail: Force | None = Field(
        None, description="its 99th percentile, written likewise; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="share of the surface that may lack the force: 0.005 at most"
    )
    query_time: Positive | None = Field(
        None,
        description="seconds of one query, median, by `config/query-times.csv` (`snakemake "
        "calibrate` measures it on your machine)",
    )
    bytes: Count | None = Field(None, description="bytes that a program holds in memory")


class BakeOptions(Options):
    """Grids. Lengths are in the unit frame (longest side 1.8)."""

    inside: Positive = Field(
        0.045, le=1, description="depth below the surface down to which grids are right"
    )
    outside: Positive = Field(0.02, le=1, description="height above it up to which they are")
    chunk: Annotated[int, Field(ge=4)] = Field(32, description="nodes per axis of a stored chunk")
    auto: dict[Literal[tuple(GRID_FIELDS)], GridTarget] = Field(
        default_factory=dict,
        description="what `nearest-auto`, `trilinear-auto`, … should achieve, by kind: "
        "`force_error` (the coarsest grid that meets it, `tail` and `missed`) or `bytes` (the "
        "finest that fits); without a word `spline-auto` gets 800,000 bytes",
    )
    vti: bool = Field(
        False, description="also write every grid field as `.vti`, for ParaView and 3D Slicer"
    )

    @model_validator(mode="after")
    def _usual_targets(self):
        for kind, target in TARGETS.items():
            self.auto.setdefault(kind, GridTarget(**target))
        return self


class ExportOptions(Options):
    """The files for user programs."""

    weight_bits: Literal[16, 32] = Field(
        32,
        description="of a network's hidden layers in its `.pandis` file; 16 halves the file, and "
        "the export's log says what it costs",
    )


class TrajectoryOptions(Options):
    """The path of the probe on the mesh, traced on exact distances."""

    kind: Literal["surface", "spiral"] = Field(
        "surface",
        description="surface: along the surface, turning at random; spiral: six turns from pole "
        "to pole of a closed-form sphere, 2 to 5 % of its radius deep whatever the depths say",
    )
    samples: Annotated[int, Field(ge=10)] = Field(2000, description="samples, one per tick")
    step: Positive = Field(0.004, description="distance between samples (unit frame)")
    shallow: Positive = Field(0.001, description="smallest depth (unit frame)")
    deep: Positive = Field(0.02, description="largest depth (unit frame)")

    @model_validator(mode="after")
    def _order(self):
        if self.shallow >= self.deep:
            raise ValueError("shallow must be less than deep")
        return self


class EvaluationOptions(Options):
    """The force error of every field against the exact force."""

    probes: Annotated[int, Field(ge=100)] = Field(50_000, description="points of each probe set")
    paths: Count = Field(
        1,
        description="trajectories that errors are measured on; of more than one the report gives "
        "means with 95 % intervals",
    )
    lines: Annotated[int, Field(ge=10)] = Field(
        1000, description="lines of 1 mm along which the jumps of the force are counted"
    )


class StressOptions(Options):
    """The stress suite: every field under a device and a hand. Nominal values of a Touch."""

    mass: Positive = Field(0.045, description="moving mass at the tip, kg")
    damping: float = Field(0.1, ge=0, description="viscous damping of the device, Ns/m")
    friction: float = Field(0.26, ge=0, description="Coulomb friction of the device, N")
    encoder: Positive = Field(55e-6, description="step of the position that it reports, m")
    delay: int = Field(0, ge=0, le=20, description="ticks by which a force comes late")
    force_limit: Positive = Field(3.3, description="largest force, N")
    hand_stiffness: float = Field(20.0, ge=0, description="of the hand that holds it, N/m")
    hand_damping: float = Field(3.0, ge=0, description="likewise, Ns/m")
    press: Positive = Field(0.5, description="force with which the hand presses, N")
    loops: Annotated[int, Field(ge=2)] = Field(
        20, description="closed loops around which the work is measured"
    )
    ticks: Annotated[int, Field(ge=1000)] = Field(
        1_000_000, description="ticks of the long run: a random walk"
    )


class TimingOptions(Options):
    """One-query and batch times."""

    queries: Annotated[int, Field(ge=100)] = Field(2000, description="single queries per field")
    batch: Count = Field(10_000, description="points of a batch")
    repeats: Count = Field(5, description="batches per field; the median counts")
    cold: Annotated[int, Field(ge=0)] = Field(
        50, description="single queries with empty caches, per field"
    )
    libtorch: bool = Field(
        False,
        description="also time every network from a C++ program on LibTorch, the paper's way; "
        "needs g++, and half a minute per network to compile it",
    )


class AttachedOptions(Options):
    """A haptic device of 3D Systems that is attached to this machine, and held by somebody."""

    library: str = Field("libHD.so", description="OpenHaptics' library, a name or a path")
    name: str = Field("", description="of the device, as set up there; empty: the default one")
    model: Literal["touch", "touch-x"] = Field(
        "touch", description="which it is: its limits are kept"
    )
    arm: bool = Field(
        False,
        description="send forces, if the environment variable PANDIS_ARM is 1 as well: "
        "`PANDIS_ARM=1 snakemake -j1 hardware`. Otherwise positions are read and no force is sent. "
        "Hold the stylus",
    )


class HardwareOptions(Options):
    """The 1 kHz validation on this machine."""

    seconds: Positive = Field(3.0, description="length of the run, per field")
    rate: Positive = Field(1000.0, ge=100, le=20_000, description="ticks per second")
    deadline: Positive = Field(
        0.8e-3, description="a tick that computes longer is a miss (s); 0.8 of the period at most"
    )
    misses: float = Field(0.001, ge=0, lt=1, description="share of misses a pass allows")
    loaded_seconds: float = Field(
        0.5, ge=0, le=600, description="length of a second run, beside a busy loop on every core"
    )
    ask_again: bool = Field(
        True,
        description="while the loop waits for a tick, ask the field once more where the probe was "
        "last, so that its bytes are still in the caches; a device's own scheduler cannot",
    )
    devices: list[Literal["touch", "touch-x", "omega-3", "falcon"]] = Field(
        ["touch"],
        description="devices that are simulated, with the hand of `stress`, to find the largest "
        "safe stiffness",
    )
    attached: AttachedOptions | None = Field(
        None, description="a device to run every field on, through OpenHaptics; null: none"
    )


_NAMES = {"type": "array", "items": {"type": "string"}, "minItems": 1}
FieldNames = Annotated[
    list[str], Field(min_length=1), WithJsonSchema({"anyOf": [{"type": "string"}, _NAMES]})
]


class StageOptions(Options):
    """All options of all stages. A mesh may override any of them."""

    seed: int = Field(0, ge=0, description="root of all random numbers")
    device: DeviceOptions = Field(default_factory=DeviceOptions, description="physical scale")
    fields: FieldNames = Field(
        [
            "exact",
            "nearest-32",
            "nearest-64",
            "trilinear-32",
            "trilinear-64",
            "trilinear-normal-64",
            "tricubic-64",
            "spline-auto",
            "pandis",
            "pandis-exact",
        ],
        description="what to build and compare: `exact`, "
        + ", ".join(f"`{kind}-N`" for kind in GRID_FIELDS)
        + " (N nodes per axis, or `auto`: see `bake.auto`), or any recipe under `train`; "
        "`fields: auto` stands alone and builds the one that `budget` asks for, and no other",
    )
    budget: BudgetOptions = Field(
        default_factory=BudgetOptions, description="what `fields: auto` should achieve"
    )
    mesh: MeshOptions = Field(default_factory=MeshOptions, description="loading and repair")
    samples: SampleOptions = Field(default_factory=SampleOptions, description="training points")
    train: dict[str, Annotated[PaperRecipe | ExactRecipe, Field(discriminator="loss")]] = Field(
        default_factory=dict,
        description="recipes by name; `loss` is `paper` or `exact` (the default, but for the "
        "recipes named `pandis` and `pandis-grad`)",
    )
    bake: BakeOptions = Field(default_factory=BakeOptions, description="grids")
    export: ExportOptions = Field(
        default_factory=ExportOptions, description="files for user programs"
    )
    trajectory: TrajectoryOptions = Field(
        default_factory=TrajectoryOptions, description="the probe's path"
    )
    evaluation: EvaluationOptions = Field(
        default_factory=EvaluationOptions, description="force errors"
    )
    stress: StressOptions = Field(default_factory=StressOptions, description="the stress suite")
    timing: TimingOptions = Field(default_factory=TimingOptions, description="query times")
    hardware: HardwareOptions = Field(
        default_factory=HardwareOptions, description="the 1 kHz validation"
    )

    @model_validator(mode="after")
    def _one_spiral(self):
        if self.trajectory.kind == "spiral" and self.evaluation.paths > 1:
            raise ValueError("a spiral is always the same path: set evaluation.paths to 1")
        return self

    @field_validator("fields", mode="before")
    @classmethod
    def _one_word(cls, value):
        return [value] if isinstance(value, str) else value

    @model_validator(mode="before")
    @classmethod
    def _name_the_loss(cls, values):
        """Recipes choose their model by `loss`; fill it in from the recipe's name."""
        if not isinstance(values, dict) or not isinstance(values.get("train") or {}, dict):
            return values
        recipes = dict.fromkeys(RECIPES) | (values.get("train") or {})
        named = {
            name: RECIPES.get(name, {"loss": "exact"}) | (recipe or {})
            if isinstance(recipe, dict | None)
            else recipe
            for name, recipe in recipes.items()
        }
        return values | {"train": named}


#: Recipes that need no entry under ``train``, and what their names stand for.
RECIPES = {
    "pandis": {"loss": "paper"},
    "pandis-grad": {"loss": "paper", "direction": "gradient"},
    "pandis-exact": {"loss": "exact"},
}
#: Steps used where a recipe names no budget (about three minutes of one CPU core).
DEFAULT_STEPS = {"paper": 3000, "exact": 1500}


class MeshEntry(StageOptions):
    """One mesh: where it comes from, and its overrides."""

    source: str = Field(
        description="a path (relative to the working directory), a URL (with `sha256`), "
        "`pymeshlab:NAME` or `analytic:NAME`"
    )
    sha256: Annotated[str, Field(pattern="^[0-9a-fA-F]{64}$")] | None = Field(
        None, description="digest of the source file; checked where given"
    )

    @model_validator(mode="after")
    def _url_needs_digest(self):
        if self.source.startswith(("http://", "https://")) and self.sha256 is None:
            raise ValueError("source: a URL needs the sha256 of the file beside it")
        return self


class SceneObject(Options):
    """An object of a scene."""

    mesh: str = Field(description="one of `meshes`")
    field: str = Field(
        description="which of its fields; it need not stand under `fields`, but must have a file "
        "for `pandis.h`"
    )
    position: tuple[Place, Place, Place] = Field(
        (0.0, 0.0, 0.0), description="where its box's centre lies (m)"
    )
    rotation: tuple[Angle, Angle, Angle] = Field(
        (0.0, 0.0, 0.0),
        description="how it is turned: the axis, as long as the angle in degrees",
    )
    size: Annotated[float, Field(ge=1e-3, le=10)] | None = Field(
        None, description="metres of its longest side; null: `device.size` of its mesh"
    )
    stiffness: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        None, description="N/m; null: `device.stiffness` of its mesh"
    )


class SceneOptions(Options):
    """Several objects under one probe. With scenes, `all` builds what they need, and no more."""

    objects: Annotated[dict[str, SceneObject], Field(min_length=1)] = Field(
        description="name: {mesh: …, field: …, and where it lies}"
    )
    ticks: Annotated[int, Field(ge=1, le=10_000_000)] = Field(
        20_000, description="ticks of the walk through the scene that tries it"
    )
    speed: Positive = Field(0.5, le=10, description="of the probe on it, m/s")


_FOLDER = r"[A-Za-z0-9_][A-Za-z0-9._-]*(/[A-Za-z0-9_][A-Za-z0-9._-]*)*"
ResultsFolder = Annotated[str, Field(pattern=f"^{_FOLDER}$")]
MeshName = Annotated[str, Field(pattern=f"^{MESH_NAME}$")]


class Config(StageOptions):
    """The whole configuration file."""

    results: ResultsFolder = Field(
        "results",
        description="folder of everything that a run makes, relative to the working directory: "
        "give every configuration its own, and none rebuilds the other's meshes",
    )

    meshes: Annotated[dict[MeshName, MeshEntry], Field(min_length=1)] = Field(
        description="name: {source: …, and any option above that differs for this mesh}"
    )
    scenes: dict[MeshName, SceneOptions] = Field(
        default_factory=dict, description="name: {objects: …}; see `scenes`"
    )


# --- reading ----------------------------------------------------------------


class _StrictLoader(yaml.SafeLoader):
    """YAML in which a key that stands twice is an error, not the last one's victory."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            name = self.construct_object(key, deep=True)
            if name in seen:
                raise PandisError(
                    f"{self.name}, line {key.start_mark.line + 1}: the key '{name}' stands twice; "
                    "rename or remove one of them"
                )
            seen.add(name)
        return super().construct_mapping(node, deep)


def check_yaml(path):
    """Raise PandisError if the YAML file has a doubled key or does not parse.

    Snakemake has read the file by then, and kept the last of two equal keys
    without a word: two meshes of one name would become one.
    """
    with Path(path).open(encoding="utf-8") as stream:
        loader = _StrictLoader(stream)
        loader.name = str(path)
        try:
            loader.get_single_data()
        except yaml.YAMLError as error:
            raise PandisError(f"{path}: not valid YAML: {error}") from error
        finally:
            loader.dispose()


_FLOAT = re.compile(r"[+-]?\d+(\.\d*)?[eE][+-]?\d+")


def _read_numbers(value):
    """Turn `1e-4` into a number: YAML 1.1 reads it as text."""
    if isinstance(value, dict):
        return {k: v if k == "source" else _read_numbers(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_read_numbers(v) for v in value]
    if isinstance(value, str) and _FLOAT.fullmatch(value):
        return float(value)
    return value


def merge(base, override):
    """Merge two nested dicts key by key; anything else in ``override`` replaces."""
    merged = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def results_folder(raw):
    """Return the folder of a configuration's results.

    Raises
    ------
    PandisError
        It is no relative path of plain names.
    """
    folder = raw.get("results", "results")
    if not isinstance(folder, str) or not re.fullmatch(_FOLDER, folder):
        said = "a folder below the working directory, such as results/front: letters, digits, . _ -"
        raise_faults({"results": f"{said} (given: {folder!r})"})
    return folder


def load_config(raw, refused=None):
    """Validate a configuration and merge each mesh's overrides.

    Parameters
    ----------
    raw : dict
        The parsed YAML.
    refused : dict, optional
        Gets the names of meshes whose own options have faults, and what is wrong: the others
        are returned. Without it, or if no mesh is left, the faults are raised.

    Returns
    -------
    dict of str to MeshEntry
        The complete options of each mesh, in the order of the file.

    Raises
    ------
    PandisError
        Lists every fault at once, each with its dotted path.
    """
    raw = _read_numbers(raw)
    apart = ("meshes", "scenes", "results", "pathvars")
    top = {key: value for key, value in raw.items() if key not in apart}
    meshes = raw.get("meshes")
    faults = _stage_faults(StageOptions, top)
    merged = {}
    if not isinstance(meshes, dict) or not meshes:
        faults["meshes"] = "at least one mesh is needed: `meshes: {name: {source: …}}`"
        meshes = {}
    shared = dict(faults)
    for name, entry in meshes.items():
        path = f"meshes.{name}"
        if not re.fullmatch(MESH_NAME, str(name)):
            faults[path] = "a mesh's name starts with a-z and goes on with a-z, 0-9, - or _"
        elif name in RESERVED_NAMES:
            faults[path] = "this name is taken by a folder of results/: choose another"
        elif not isinstance(entry, dict):
            faults[path] = "expected a mapping such as {source: path/to/mesh.obj}"
        else:
            options = merge(top, entry)
            own = _stage_faults(MeshEntry, options)
            for key, message in own.items():
                if key not in faults:
                    faults[f"{path}.{key}" if key else path] = message
            if not own:
                merged[name] = MeshEntry.model_validate(options)
    if refused is not None and merged and not shared:
        for key, message in faults.items():
            # a name that is none may have a dot in it
            name = next(n for n in meshes if f"{key}.".startswith(f"meshes.{n}."))
            told = f"{key}: {message}"
            refused[name] = f"{refused[name]}; {told}" if name in refused else told
        faults = {}
    raise_faults(faults)
    return merged


def _stage_faults(model, values):
    """Map dotted path to message for all faults of stages' options, names of fields included."""
    faults = faults_of(model, values)
    for key, message in name_faults(values):
        faults.setdefault(key, message)
    return faults


def raise_faults(faults):
    """Raise a PandisError that lists faults, messages by dotted path, if there are any."""
    if faults:
        lines = [f"  {key or 'config'}: {message}" for key, message in faults.items()]
        raise PandisError(
            f"the configuration has {len(lines)} fault{'s' * (len(lines) > 1)}:\n"
            + "\n".join(lines)
            + "\nEvery option is described in config/README.md."
        )


def faults_of(model, values):
    """Map dotted path to message for everything that ``model`` refuses in ``values``."""
    try:
        model.model_validate(values)
    except ValidationError as error:
        return dict(_describe(fault, model) for fault in error.errors(include_url=False))
    return {}


def name_faults(values):
    """Yield path and message for every recipe and field whose name cannot be."""
    recipes = values.get("train") or {}
    names = values.get("fields", StageOptions.model_fields["fields"].default)
    names = [names] if isinstance(names, str) else names
    if not isinstance(recipes, dict) or not isinstance(names, list):
        return  # the models have said so
    for name in recipes:
        if not re.fullmatch(MESH_NAME, str(name)) or is_builtin_field(str(name)):
            yield (
                f"train.{name}",
                "a recipe's name is made of a-z, 0-9, - and _ and is not that of a built-in "
                "field: rename it",
            )
    known = {"pandis": None, "pandis-exact": None} | recipes
    if AUTO in names and len(names) > 1:
        yield "fields", "auto stands alone: it is the one field that the budget asks for"
        return
    for index, name in enumerate(names):
        if name in names[:index]:
            yield f"fields.{index}", f"{name} is listed twice: remove one"
        try:
            spec = parse_field(str(name), known)
        except ValueError as error:
            near = near_field(str(name), known)
            yield f"fields.{index}", str(error) + (f"; did you mean '{near}'?" if near else "")
            continue
        spec = spec.through or spec
        budget = values.get("budget") or {}
        if spec.kind == AUTO and not (isinstance(budget, dict) and budget.get("force_error")):
            yield (
                f"fields.{index}",
                "auto needs to know what to achieve: add budget.force_error, such as 0.001",
            )
        if spec.size == "auto" and spec.kind not in _targets(values):
            yield (
                f"fields.{index}",
                f"{spec.name} needs to know what to achieve: add bake.auto.{spec.kind}, with "
                "force_error or bytes",
            )


def near_field(name, recipes):
    """Return the field whose name is most like one that is no field's, or None."""
    kind, dash, size = name.rpartition("-")
    if dash and (size.isdigit() or size == AUTO):
        near = difflib.get_close_matches(kind, list(GRID_FIELDS), n=1, cutoff=0.7)
        return f"{near[0]}-{size}" if near and near[0] != kind else None
    known = ["exact", AUTO, *PLANE_FIELDS, PROXY, *recipes]
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return near[0] if near and near[0] != name else None


def _targets(values):
    """Return the kinds of grids that have a target."""
    bake = values.get("bake") or {}
    given = bake.get("auto") or {} if isinstance(bake, dict) else {}
    return {*TARGETS, *(given if isinstance(given, dict) else ())}


def _describe(fault, model):
    path = [str(part) for part in fault["loc"]]
    # the tag of the chosen recipe stands in pydantic's path, but not in the file
    if len(path) > 2 and path[0] == "train" and path[2] in ("paper", "exact"):
        del path[2]
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(path[-1], _known_keys(model, path[:-1], fault), n=1)
        message = "unknown option" + (f"; did you mean '{near[0]}'?" if near else "")
    elif fault["type"] == "missing":
        message = "missing"
    else:
        given = fault.get("input")
        if not isinstance(given, dict | list | BaseModel) and path:
            message += f" (given: {given!r})"
    # a cross-check names its key itself
    if fault["type"] == "value_error" and (match := re.match(r"([a-z][\w.-]*): ", message)):
        path.append(match[1])
        message = message[match.end() :]
    return ".".join(path), message


def _known_keys(model, path, fault):
    if path[:1] == ["train"] and len(path) > 1:
        tag = next((p for p in fault["loc"] if p in ("paper", "exact")), "exact")
        return list((PaperRecipe if tag == "paper" else ExactRecipe).model_fields)
    for part in path:
        field = model.model_fields.get(part)
        if field is None or not isinstance(field.annotation, type):
            return []
        model = field.annotation
    return list(model.model_fields)


# --- what each stage is asked -------------------------------------------------


def plain(value):
    """Return ``value`` as sorted plain dicts, lists and scalars, fit for a rule's params."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, dict):
        return {key: plain(value[key]) for key in sorted(value)}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value


def recipe_options(entry, name):
    """Return the options of one recipe with its budget filled in."""
    options = entry.train[name].model_dump()
    if options["steps"] is None and options["seconds"] is None:
        options["steps"] = DEFAULT_STEPS[options["loss"]]
    return options


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration file, for editors."""
    schema = Config.model_json_schema()
    # in the file, `loss` may be left out, so the recipe's kind cannot be told by its tag
    for definition in schema["$defs"].values():
        train = definition.get("properties", {}).get("train")
        if train:
            train["additionalProperties"].pop("discriminator", None)
            train["additionalProperties"]["anyOf"] = train["additionalProperties"].pop("oneOf")
    top = schema["properties"]["train"]["additionalProperties"]
    top.pop("discriminator", None)
    top["anyOf"] = top.pop("oneOf")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema

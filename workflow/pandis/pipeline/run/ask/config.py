"""The contents of a configuration file, checked before anything runs.

The models here, in `pandis.pipeline.run.ask.options` and in `pandis.pipeline.run.ask.recipes` are
the single source of the options' names, defaults and meaning. From them ``make docs`` generates
``workflow/schemas/config.schema.json`` and the tables of ``config/README.md``.

These modules run whenever the workflow is planned, and import neither torch nor trimesh.
"""

from contextlib import suppress
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, WithJsonSchema, field_validator, model_validator

from pandis.pipeline.run.ask.catalogue import MESH_NAME, in_order, parse_field
from pandis.pipeline.run.ask.contacts import ContactOptions, SurfaceOptions
from pandis.pipeline.run.ask.datasets import DatasetOptions
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.options import (
    BakeOptions,
    EvaluationOptions,
    ExportOptions,
    HardwareOptions,
    MeshOptions,
    SampleOptions,
    StressOptions,
    TimingOptions,
    TrajectoryOptions,
)
from pandis.pipeline.run.ask.outputs import distance_fields
from pandis.pipeline.run.ask.recipes import RECIPES, ExactRecipe, PaperRecipe
from pandis.pipeline.run.ask.targets import BudgetOptions, DeviceOptions
from pandis.pipeline.run.ask.values import Angle, Length, Options, Place, Positive

#: Fewest points on which a network's error is measured.
LEAST_HELD_OUT = 100
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
            "compact-auto",
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
        description="fields to build and compare: "
        + ", ".join(kind.help for kind in KINDS.values() if kind.help)
        + "; `fields: auto`, as the only entry, builds the one field that `budget` describes",
    )
    budget: BudgetOptions = Field(
        default_factory=BudgetOptions, description="requirements on the field of `fields: auto`"
    )
    mesh: MeshOptions = Field(default_factory=MeshOptions, description="loading and repair")
    samples: SampleOptions = Field(default_factory=SampleOptions, description="training points")
    train: dict[str, Annotated[PaperRecipe | ExactRecipe, Field(discriminator="loss")]] = Field(
        default_factory=dict,
        description="recipes by name; `loss` is `paper` or `exact` (the default, except for "
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

    contact: ContactOptions = Field(
        default_factory=ContactOptions, description="how the object feels on a device"
    )

    @model_validator(mode="after")
    def _one_spiral(self):
        if self.trajectory.kind == "spiral" and self.evaluation.paths > 1:
            raise ValueError("a spiral is always the same path: set evaluation.paths to 1")
        return self

    @model_validator(mode="after")
    def _in_order(self):
        with suppress(ValueError):  # an invalid field name is reported separately
            self.fields = in_order(self.fields, self.train)
        return self

    @model_validator(mode="after")
    def _networks_need_points(self):
        try:
            specs = [parse_field(name, self.train) for name in self.fields]
        except ValueError:
            return self  # an invalid field name is reported separately
        learned = any(spec.kind == AUTO or (spec.through or spec).learned for spec in specs)
        for name, least in ("surface", 1), ("held_out", LEAST_HELD_OUT):
            if learned and getattr(self.samples, name) < least:
                raise ValueError(f"samples.{name}: networks need at least {least}")
        return self

    @field_validator("fields", mode="before")
    @classmethod
    def _one_word(cls, value):
        return [value] if isinstance(value, str) else value

    @model_validator(mode="before")
    @classmethod
    def _name_the_loss(cls, values):
        """Fill in each recipe's `loss`, which selects its model, from the recipe's name."""
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


class MeshEntry(StageOptions):
    """One mesh: its source, and its overrides."""

    source: str = Field(
        description="a path (relative to the working directory), a URL (with `sha256`), "
        "`pymeshlab:NAME` or `analytic:NAME`"
    )
    sha256: Annotated[str, Field(pattern="^[0-9a-fA-F]{64}$")] | None = Field(
        None, validate_default=True, description="digest of the source file; checked if given"
    )

    @field_validator("sha256")
    @classmethod
    def _url_needs_digest(cls, value, info):
        if value is None and info.data.get("source", "").startswith(("http://", "https://")):
            raise ValueError("a URL needs the sha256 of its file")
        return value

    @model_validator(mode="after")
    def _formats_need_distances(self):
        formats = [kind for kind in self.export.also if kind != "newton"]
        try:
            fields = distance_fields(self) if formats else [None]
        except ValueError:
            return self  # an invalid field name is reported separately
        if not fields:
            raise ValueError(
                f"export.also: {', '.join(formats)}: all fields are grids of forces, which have no "
                "distances outside: add another field to fields"
            )
        return self


class SceneObject(Options):
    """An object of a scene."""

    mesh: str = Field(description="name of one of the `meshes`")
    field: str = Field(
        description="name of a field of that mesh; it need not be listed under `fields`, but needs "
        "a file for `pandis.h`"
    )
    position: tuple[Place, Place, Place] = Field(
        (0.0, 0.0, 0.0), description="position of the centre of its bounding box, m"
    )
    rotation: tuple[Angle, Angle, Angle] = Field(
        (0.0, 0.0, 0.0),
        description="rotation vector: its direction is the axis, its length the angle in degrees",
    )
    size: Annotated[Length, Field(ge=1e-3, le=10)] | None = Field(
        None,
        description="length of its longest side, m, or with its unit; null: `device.size` of its "
        "mesh",
    )
    stiffness: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        None, description="its stiffness, N/m; null: `device.stiffness` of its mesh"
    )


class SceneOptions(Options):
    """Several objects under one probe. With scenes, `all` builds only what they need."""

    objects: Annotated[dict[str, SceneObject], Field(min_length=1)] = Field(
        description="objects by name, as {mesh: …, field: …, and its placement}"
    )
    ticks: Annotated[int, Field(ge=1, le=10_000_000)] = Field(
        20_000, description="ticks of the trial path through the scene"
    )
    speed: Positive = Field(0.5, le=10, description="speed of the probe on that path, m/s")
    radius: float = Field(0.0, ge=0, le=0.1, description="radius of the probe, m; used by proxies")
    contact: SurfaceOptions | None = Field(
        None,
        description="how the scene's objects feel: the options of `contact`, without those of the "
        "probe; null: as in their meshes' options",
    )


FOLDER = r"/?[A-Za-z0-9_][A-Za-z0-9._-]*(/[A-Za-z0-9_][A-Za-z0-9._-]*)*"
#: Options of the whole file, which no mesh overrides.
APART = ("meshes", "datasets", "scenes", "results", "until", "pathvars")
ResultsFolder = Annotated[str, Field(pattern=f"^{FOLDER}$")]
MeshName = Annotated[str, Field(pattern=f"^{MESH_NAME}$")]


class Config(StageOptions):
    """The whole configuration file."""

    results: ResultsFolder = Field(
        "results",
        description="folder of all outputs of a run, absolute or below the working directory; "
        "configurations with separate folders do not rebuild each other's meshes",
    )

    until: Literal["meshes", "samples", "exports"] | None = Field(
        None,
        description="make only the repaired `meshes`, or these and their `samples`, or everything "
        "up to the `exports`; and, instead of the report, one table of all meshes: for large "
        "collections. null: make everything",
    )
    meshes: dict[MeshName, MeshEntry] = Field(
        default_factory=dict,
        description="name: {source: …, and any option above that differs for this mesh}",
    )
    datasets: dict[MeshName, DatasetOptions] = Field(
        default_factory=dict, description="name: {source: …}; see `datasets`"
    )
    scenes: dict[MeshName, SceneOptions] = Field(
        default_factory=dict, description="name: {objects: …}; see `scenes`"
    )


def plain(value):
    """Return ``value`` as plain sorted dicts, lists and scalars, suitable as a rule's params."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, dict):
        return {key: plain(value[key]) for key in sorted(value)}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration file, for editors."""
    schema = Config.model_json_schema()
    # the file may leave `loss` out, so it cannot serve as the discriminator there
    for definition in schema["$defs"].values():
        train = definition.get("properties", {}).get("train")
        if train:
            train["additionalProperties"].pop("discriminator", None)
            train["additionalProperties"]["anyOf"] = train["additionalProperties"].pop("oneOf")
    top = schema["properties"]["train"]["additionalProperties"]
    top.pop("discriminator", None)
    top["anyOf"] = top.pop("oneOf")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema

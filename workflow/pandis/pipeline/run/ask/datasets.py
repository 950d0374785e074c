"""Data sets in the configuration: many meshes under one name, labelled with the same options."""

from typing import Any

from pydantic import Field, field_validator

from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.options import MeshOptions, SampleOptions
from pandis.pipeline.run.ask.values import Options, Positive

#: Counts of points by default: those of the strata that neural distances are trained on.
LABELS = {
    "surface": 100_000, "near": 200_000, "volume": 50_000, "offsets": 0, "shallow": 0,
    "penetration": 0, "bent": 0, "core": 0, "box": 0, "held_out": 0,
}  # fmt: skip


class Override(Options):
    """Options of one mesh of a data set that differ from the others'."""

    mesh: dict[str, Any] = Field(default_factory=dict, description="as in `mesh`")
    samples: dict[str, Any] = Field(default_factory=dict, description="as in `samples`")


class DatasetOptions(Options):
    """A data set. None of the options of the file but `seed` apply to it."""

    source: str = Field(
        min_length=1,
        description="a folder (searched deeply), a pattern (`meshes/**/*.obj`), an archive (.zip, "
        ".tar, .tar.gz, …), a list (.txt: a path or URL per line, a URL followed by its sha256), "
        "or a table (.csv with the column `source`)",
    )
    table: str | None = Field(
        None,
        description="CSV with a row for each mesh: `name` (its path in the source, without the "
        "ending), and if wanted `unit`, `licence`, `tags` and `sha256`",
    )
    seed: int | None = Field(None, ge=0, description="root of all random numbers; that of the file")
    mesh: MeshOptions = Field(
        default_factory=lambda: MeshOptions(solid="always"),
        description="loading and repair; `solid` is `always` here, unless it is set",
    )
    samples: SampleOptions = Field(
        default_factory=lambda: SampleOptions(**LABELS),
        description="points; by default `surface: 100000, near: 200000, volume: 50000`, others 0",
    )
    fields: list[str] = Field(
        default_factory=list,
        description="fields of each mesh that are stored as files for `pandis.h`, built with "
        "default options: kinds that need no training, such as `compact-16`",
    )
    override: dict[str, Override] = Field(
        default_factory=dict, description="`mesh` and `samples` of single meshes, by their names"
    )
    shards: int | None = Field(
        None, ge=1, le=100_000, description="number of jobs and files; chosen by the meshes' number"
    )
    chunk: int = Field(
        16_384, ge=256, le=1 << 20, description="rows that are stored, and read, together"
    )
    seconds: Positive = Field(300.0, le=1e6, description="time that one mesh may take")
    memory_gb: Positive = Field(
        4.0,
        le=1e6,
        description="address space that one mesh may take (GiB); `union` and `fill` may take "
        "`mesh.rung_memory_gb` more",
    )

    @field_validator("fields")
    @classmethod
    def _untrained(cls, names):
        for name in names:
            spec = parse_field(name, ())
            known = spec.size != AUTO or spec.form in KINDS[spec.kind].targets
            if spec.kind == AUTO or not spec.native or not known:
                raise ValueError(
                    f"{name} cannot be stored: name a field that has a file for pandis.h and, "
                    "without a size, a default target, such as compact-16 or spline-auto"
                )
        if len(set(names)) < len(names):
            raise ValueError("a field is named twice")
        return sorted(names)

    @field_validator("mesh", mode="before")
    @classmethod
    def _solid(cls, value):
        return {"solid": "always"} | value if isinstance(value, dict) else value

    @field_validator("samples", mode="before")
    @classmethod
    def _labels(cls, value):
        return LABELS | value if isinstance(value, dict) else value

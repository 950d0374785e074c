"""The stages of a mesh: the outputs, the options and the target of each.

A stage is one rule and one script of the same name. Outputs, options and named targets, and which
outputs scenes need, are defined only in `STAGES`.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pandis.pipeline.run.ask import outputs
from pandis.pipeline.run.ask.config import MeshEntry
from pandis.pipeline.run.ask.kind import FieldSpec
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.recipes import budgeted
from pandis.pipeline.run.ask.tasks import (
    ChooseTask,
    EvaluateTask,
    ExportMeshTask,
    ExportMjcfTask,
    ExportNativeTask,
    ExportNewtonTask,
    ExportPageTask,
    ExportTask,
    ExportVdbTask,
    FetchTask,
    HandOptions,
    MeshTask,
    SampleTask,
    StressTask,
    TimingTask,
    TrajectoryTask,
    ValidateTask,
)


class Output(NamedTuple):
    """One output file, the stage (rule, script) that makes it and its wildcards."""

    path: str
    stage: str
    wildcards: dict


#: Recipe of the networks that `fields: auto` may choose.
CHOSEN_RECIPE = "pandis-exact"
#: Scale passed to jobs that do not depend on the device's scale, so that a change to that scale
#: makes none of them stale.
NOMINAL = {"size": 0.10, "stiffness": 400.0}


def stage_seed(root, *names):
    """Return the seed of a stage: a hash of the configuration's seed and the names."""
    text = "\0".join([str(root), *names])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "little")


@dataclass(frozen=True)
class PlannedJob:
    """A planned job: its stage, mesh, options and wildcards.

    If the job builds fields, ``built`` is one of the fields that its artifact contains.
    """

    stage: str
    mesh: str
    entry: MeshEntry
    wildcards: dict
    built: FieldSpec | None = None

    @property
    def seed(self):
        """The job's seed, derived from the stage's name or, for a field, from `Kind.stream`."""
        names = KINDS[self.built.kind].stream(self.built) if self.built else (self.stage,)
        return stage_seed(self.entry.seed, self.mesh, *names)

    @property
    def scale(self):
        """The device's scale, as options."""
        return dict(self.entry.device)

    def scale_of(self, target):
        """Return the device's scale if the target limits a force error, else `NOMINAL`.

        The error may be in newtons.
        """
        return self.scale if target and target.force_error is not None else NOMINAL

    @property
    def band(self):
        """Depth below the surface and height above it to which grids are valid (unit frame)."""
        return [self.entry.bake.inside, self.entry.bake.outside]


@dataclass(frozen=True)
class Stage:
    """A row of `STAGES`.

    Attributes
    ----------
    outputs : callable
        Takes a mesh's options; returns a pair for each output: its path relative to the mesh's
        folder, and the wildcards of its rule except the mesh.
    options : callable
        Returns the options of a `PlannedJob`, as a model from `pandis.pipeline.run.ask.tasks`. A
        change to any of them makes the job stale.
    target : str or None
        The named target that the outputs belong to.
    in_scenes : bool
        Whether the objects of a scene need the outputs.
    """

    outputs: Callable
    options: Callable
    target: str | None = None
    in_scenes: bool = False


# --- options of each stage ------------------------------------------------------


def _fetch(job):
    return FetchTask(url=job.entry.source, sha256=job.entry.sha256)


def _mesh(job):
    entry = job.entry
    return MeshTask(**dict(entry.mesh), source=entry.source, sha256=entry.sha256, seed=job.seed)


def _sample(job):
    return SampleTask(**dict(job.entry.samples), seed=job.seed)


def _build(job):
    return KINDS[job.built.kind].options(job, job.built)


def _choose(job):
    entry = job.entry
    return ChooseTask(
        budget=entry.budget,
        name=CHOSEN_RECIPE,
        recipe=budgeted(entry.train[CHOSEN_RECIPE]),
        samples=entry.samples,
        stress=entry.stress,
        weight_bits=entry.export.weight_bits,
        band=job.band,
        seed=job.seed,
        **job.scale,
    )


def _export(job):
    return ExportTask(field=job.wildcards["field"])


def _export_native(job):
    options = {key: value for key, value in job.entry.export if key != "also"}
    return ExportNativeTask(**options, field=job.wildcards["field"])


def _export_page(job):
    return ExportPageTask(**job.scale, fields=_measuring(job))


def _export_mjcf(job):
    return ExportMjcfTask(size=job.entry.device.size, fields=_measuring(job))


def _export_newton(job):
    return ExportNewtonTask(size=job.entry.device.size)


def _export_vdb(job):
    return ExportVdbTask(fields=_measuring(job))


def _measuring(job):
    return [spec.name for spec in outputs.distance_fields(job.entry)]


def _trajectory(job):
    return TrajectoryTask(**dict(job.entry.trajectory), seed=job.seed)


def _evaluate(job):
    entry = job.entry
    trajectory = entry.trajectory if entry.evaluation.paths > 1 else None
    return EvaluateTask(
        **dict(entry.evaluation),
        **job.scale,
        fields=entry.fields,
        trajectory=trajectory,
        seed=job.seed,
    )


def _stress(job):
    entry = job.entry
    options = {"fields": entry.fields, "proxies": entry.contact.kind == "proxy", "seed": job.seed}
    return StressTask(**dict(entry.stress), **job.scale, **options)


def _timing(job):
    specs = outputs.field_specs(job.entry)
    in_python = [spec.name for spec in specs if "onnx" not in spec.exports]
    return TimingTask(**dict(job.entry.timing), in_python=in_python)


def _validate(job):
    entry, stress = job.entry, job.entry.stress
    hand = HandOptions(
        stiffness=stress.hand_stiffness,
        damping=stress.hand_damping,
        press=stress.press,
        delay=stress.delay,
    )
    native = [spec.name for spec in outputs.field_specs(entry) if spec.native]
    return ValidateTask(
        **dict(entry.hardware),
        **job.scale,
        hand=hand,
        contact=entry.contact,
        fields=native,
        seed=job.seed,
    )


#: All stages of a mesh, in build order. The stages that scenes need are built in the same order.
STAGES = {
    "fetch": Stage(outputs.source, _fetch, in_scenes=True),
    "mesh": Stage(outputs.one_file("mesh.zarr.zip"), _mesh, "meshes", in_scenes=True),
    "sample": Stage(outputs.samples, _sample, "samples", in_scenes=True),
    "train": Stage(outputs.models, _build, "models", in_scenes=True),
    "choose": Stage(outputs.choice, _choose, "models", in_scenes=True),
    "bake": Stage(outputs.baked, _build, "grids", in_scenes=True),
    "export_graph": Stage(outputs.graphs, _export, "exports"),
    "export_vti": Stage(outputs.images, _export, "exports"),
    "export_native": Stage(outputs.native, _export_native, "exports", in_scenes=True),
    "export_mesh": Stage(
        outputs.also("mjcf", "export/mesh.obj"), lambda job: ExportMeshTask(), "exports"
    ),
    "export_mjcf": Stage(outputs.also("mjcf", "export/mujoco.xml"), _export_mjcf, "exports"),
    "export_newton": Stage(outputs.also("newton", "export/newton.npz"), _export_newton, "exports"),
    "export_page": Stage(outputs.also("page", "export/touch.html"), _export_page, "exports"),
    "export_vdb": Stage(outputs.also("vdb", "export/fields.vdb"), _export_vdb, "exports"),
    "trajectory": Stage(outputs.one_file("trajectory.zarr.zip"), _trajectory, "evaluations"),
    "evaluate": Stage(outputs.one_file("evaluation.zarr.zip"), _evaluate, "evaluations"),
    "stress": Stage(outputs.one_file("stress.zarr.zip"), _stress, "evaluations"),
    "timing": Stage(outputs.one_file("timing.zarr.zip"), _timing, "evaluations"),
    "validate": Stage(outputs.hardware, _validate, "hardware"),
}  # fmt: skip

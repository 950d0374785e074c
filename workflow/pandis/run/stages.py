"""The stages of a mesh: what each one makes, what it is asked, and which target asks for it.

A stage is one rule and one script of its name. Outputs, options, named targets and what scenes
need are read off `STAGES`, and nothing else says them again.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

from pandis.run.catalogue import AUTO, COMPACT, GRID_FIELDS, PLANE_FIELDS, parse_field
from pandis.run.config import MeshEntry
from pandis.run.recipes import budgeted
from pandis.run.sourcing import url_extension
from pandis.run.tasks import (
    BakeAutoTask,
    BakeCompactAutoTask,
    BakeCompactTask,
    BakeSplineTask,
    BakeTask,
    ChooseTask,
    EvaluateTask,
    ExportNativeTask,
    ExportPageTask,
    ExportTask,
    FetchTask,
    HandOptions,
    MeshTask,
    SampleTask,
    StressTask,
    SupportPlanesTask,
    TimingTask,
    TrainTask,
    TrajectoryTask,
    ValidateTask,
)

#: The recipe of networks that `fields: auto` may come to.
CHOSEN_RECIPE = "pandis-exact"
#: The scale that errors are told at where nothing depends on the device's: no option goes stale.
NOMINAL = {"size": 0.10, "stiffness": 400.0}


def field_specs(entry):
    """Return the FieldSpec of every field of a mesh's options."""
    return [parse_field(name, entry.train) for name in entry.fields]


def field_holders(entry):
    """Return one FieldSpec for each artifact that holds a field, except the mesh itself.

    The field that a contact point's runs through is among them.
    """
    specs = [spec.through or spec for spec in field_specs(entry)]
    return [s for s in {s.artifact: s for s in specs}.values() if s.artifact != "mesh"]


def stage_seed(root, *names):
    """Return the seed of a stage: a hash of the configuration's seed and the names."""
    text = "\0".join([str(root), *names])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "little")


@dataclass(frozen=True)
class PlannedJob:
    """A job that is planned: of which stage and mesh, with which options and wildcards."""

    stage: str
    mesh: str
    entry: MeshEntry
    wildcards: dict

    @property
    def seed(self):
        """The seed of the stage; of a recipe's training one of its own."""
        recipe = [self.wildcards["recipe"]] if self.stage == "train" else []
        return stage_seed(self.entry.seed, self.mesh, self.stage, *recipe)

    @property
    def scale(self):
        """The scale of the device as options."""
        return dict(self.entry.device)

    @property
    def band(self):
        """How far a grid reaches into the surface and out of it."""
        return [self.entry.bake.inside, self.entry.bake.outside]


@dataclass(frozen=True)
class Stage:
    """A row of the table.

    Attributes
    ----------
    outputs : callable
        Yields, for a mesh's options, the path of each output below the mesh's folder and the
        wildcards of its rule, besides the mesh.
    options : callable
        Returns what a `PlannedJob` is asked (`pandis.run.tasks`), and nothing else: a change here
        makes it stale.
    target : str or None
        The named target that asks for the outputs.
    in_scenes : bool
        Whether the objects of a scene need it.
    """

    outputs: Callable
    options: Callable
    target: str | None = None
    in_scenes: bool = False


# --- what a stage makes ---------------------------------------------------------


def _file(name):
    """Return the function that yields one file that every mesh has."""
    return lambda entry: [(name, {})]


def _source(entry):
    extension = url_extension(entry.source)
    return [(f"source.{extension}", {"extension": extension})] if extension else []


def _networks(entry):
    return [spec for spec in field_holders(entry) if spec.kind == "network"]


def _samples(entry):
    return [("samples.zarr.zip", {})] if _networks(entry) else []


def _models(entry):
    return [(f"{s.artifact}.zarr.zip", {"recipe": s.name}) for s in _networks(entry)]


def _programs(entry):
    networks = [spec for spec in field_specs(entry) if spec.kind == "network"]
    return [
        (f"export/{spec.name}.{ending}", {"recipe": spec.name})
        for spec in networks
        for ending in ("onnx", "pt2")
    ]


def _holders(wanted, wildcards=lambda spec: {}):
    """Return the function that yields the artifacts that hold the wanted fields."""
    return lambda entry: [
        (f"{spec.artifact}.zarr.zip", wildcards(spec))
        for spec in field_holders(entry)
        if wanted(spec)
    ]


def _is_sized(spec):
    return spec.kind in GRID_FIELDS and spec.size != AUTO


def _is_dense(spec):
    return _is_sized(spec) and GRID_FIELDS[spec.kind] != "spline"


def _is_spline(spec):
    return _is_sized(spec) and GRID_FIELDS[spec.kind] == "spline"


def _is_searched(spec):
    return spec.kind in GRID_FIELDS and spec.size == AUTO


def _is_compact(spec):
    return spec.kind == COMPACT and spec.size != AUTO


def _grids(entry):
    return [spec for spec in field_specs(entry) if spec.kind in GRID_FIELDS]


def _graphs(entry):
    grids = [spec for spec in _grids(entry) if "onnx" in spec.exports]
    return [(f"export/{spec.name}.onnx", {"field": spec.name}) for spec in grids]


def _images(entry):
    grids = _grids(entry) if entry.bake.vti else []
    return [(f"export/{spec.name}.vti", {"field": spec.name}) for spec in grids]


def _native(entry):
    native = [spec for spec in field_specs(entry) if spec.native]
    return [(f"export/{spec.name}.pandis", {"name": spec.name}) for spec in native]


def touchable(entry):
    """Return the fields of a mesh's options that may have a proxy; of `auto` its file says."""
    forces = ("force", "force-box")
    native = [spec for spec in field_specs(entry) if spec.native]
    return [spec for spec in native if GRID_FIELDS.get(spec.kind) not in forces]


def _page(entry):
    return [("export/touch.html", {})] if entry.export.page and touchable(entry) else []


def _hardware(entry):
    return [("hardware.zarr.zip", {}), ("hardware.json", {})]


# --- what a stage is asked ------------------------------------------------------


def _scale(job, target):
    """Return the device's scale where a target is an error: newtons depend on it."""
    return NOMINAL if target.force_error is None else job.scale


def _fetch(job):
    return FetchTask(url=job.entry.source, sha256=job.entry.sha256)


def _mesh(job):
    entry = job.entry
    return MeshTask(**dict(entry.mesh), source=entry.source, sha256=entry.sha256, seed=job.seed)


def _sample(job):
    return SampleTask(**dict(job.entry.samples), seed=job.seed)


def _train(job):
    name = job.wildcards["recipe"]
    recipe = budgeted(job.entry.train[name])
    scale = _scale(job, recipe) if recipe.loss == "exact" else NOMINAL
    return TrainTask(name=name, recipe=recipe, seed=job.seed, **scale)


def _bake(job):
    content, size = job.wildcards["content"], int(job.wildcards["size"])
    return BakeTask(content=content, size=size, band=job.band, chunk=job.entry.bake.chunk)


def _bake_spline(job):
    return BakeSplineTask(size=int(job.wildcards["size"]), band=job.band, seed=job.seed)


def _bake_auto(job):
    kind = job.wildcards["kind"]
    target = job.entry.bake.auto[kind]
    return BakeAutoTask(
        **dict(target), **_scale(job, target), kind=kind, band=job.band, seed=job.seed
    )


def _bake_compact(job):
    return BakeCompactTask(bits=int(job.wildcards["bits"]), seed=job.seed)


def _bake_compact_auto(job):
    target = job.entry.bake.auto[COMPACT]
    return BakeCompactAutoTask(**dict(target), **_scale(job, target), seed=job.seed)


def _support_planes(job):
    return SupportPlanesTask()


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


def _export(wildcard):
    """Return the function that says which field, of the wildcard's name, is exported."""
    return lambda job: ExportTask(field=job.wildcards[wildcard])


def _export_native(job):
    given = {key: value for key, value in job.entry.export if key != "page"}
    return ExportNativeTask(**given, field=job.wildcards["name"])


def _export_page(job):
    return ExportPageTask(**job.scale, fields=[spec.name for spec in touchable(job.entry)])


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
    asked = {"fields": entry.fields, "proxies": entry.contact.kind == "proxy", "seed": job.seed}
    return StressTask(**dict(entry.stress), **job.scale, **asked)


def _timing(job):
    in_python = [spec.name for spec in field_specs(job.entry) if not spec.exports]
    return TimingTask(**dict(job.entry.timing), in_python=in_python)


def _validate(job):
    entry, stress = job.entry, job.entry.stress
    hand = HandOptions(
        stiffness=stress.hand_stiffness,
        damping=stress.hand_damping,
        press=stress.press,
        delay=stress.delay,
    )
    native = [spec.name for spec in field_specs(entry) if spec.native]
    return ValidateTask(
        **dict(entry.hardware),
        **job.scale,
        hand=hand,
        contact=entry.contact,
        fields=native,
        seed=job.seed,
    )


#: All stages of a mesh in building order. What a scene needs comes in the same order.
STAGES = {
    "fetch": Stage(_source, _fetch, in_scenes=True),
    "mesh": Stage(_file("mesh.zarr.zip"), _mesh, "meshes", in_scenes=True),
    "sample": Stage(_samples, _sample, "samples", in_scenes=True),
    "train": Stage(_models, _train, "models", in_scenes=True),
    "export_network": Stage(_programs, _export("recipe"), "exports"),
    "choose": Stage(_holders(lambda s: s.kind == AUTO), _choose, "models", in_scenes=True),
    "support_planes": Stage(
        _holders(lambda s: s.kind in PLANE_FIELDS), _support_planes, "grids", in_scenes=True
    ),
    "bake_auto": Stage(
        _holders(_is_searched, lambda s: {"kind": s.kind}), _bake_auto, "grids", in_scenes=True
    ),
    "bake_compact": Stage(
        _holders(_is_compact, lambda s: {"bits": str(s.size)}), _bake_compact, "grids",
        in_scenes=True,
    ),
    "bake_compact_auto": Stage(
        _holders(lambda s: s.kind == COMPACT and s.size == AUTO), _bake_compact_auto, "grids",
        in_scenes=True,
    ),
    "bake_spline": Stage(
        _holders(_is_spline, lambda s: {"size": str(s.size)}), _bake_spline, "grids", in_scenes=True
    ),
    "bake": Stage(
        _holders(_is_dense, lambda s: {"content": GRID_FIELDS[s.kind], "size": str(s.size)}),
        _bake, "grids", in_scenes=True,
    ),
    "export_grid": Stage(_graphs, _export("field"), "exports"),
    "export_vti": Stage(_images, _export("field"), "exports"),
    "export_native": Stage(_native, _export_native, "exports", in_scenes=True),
    "export_page": Stage(_page, _export_page, "exports"),
    "trajectory": Stage(_file("trajectory.zarr.zip"), _trajectory, "evaluations"),
    "evaluate": Stage(_file("evaluation.zarr.zip"), _evaluate, "evaluations"),
    "stress": Stage(_file("stress.zarr.zip"), _stress, "evaluations"),
    "timing": Stage(_file("timing.zarr.zip"), _timing, "evaluations"),
    "validate": Stage(_hardware, _validate, "hardware"),
}  # fmt: skip

"""What a run makes: every output of a configuration, and what each rule is given.

The Snakefile makes one `Plan`; rules take their params and inputs from it, the
targets their file lists, and `verify` compares it with what lies in results/.
Ground floor: no torch, no trimesh.
"""

import hashlib
import json
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pandis.catalogue import AUTO, GRID_FIELDS, PLANE_FIELDS, parse_field
from pandis.config import check_yaml, load_config, plain, recipe_options, results_folder
from pandis.errors import PandisError
from pandis.placing import STAGES as SCENE_STAGES
from pandis.placing import load_scenes, needed, scene_options
from pandis.provenance import CodeDigests, unused_modules
from pandis.sourcing import ANALYTIC, SHIPPED, SourceDigests, source_fault, url_extension

#: Named targets and the stages whose outputs they ask for.
TARGETS = {
    "meshes": ("mesh",),
    "samples": ("sample",),
    "models": ("train", "choose"),
    "exports": ("export_grid", "export_network", "export_native", "export_vti"),
    "grids": ("bake", "bake_spline", "bake_auto", "support_planes"),
    "evaluations": ("trajectory", "evaluate", "stress", "timing"),
    "hardware": ("validate",),
    "scenes": ("scene",),
}
DEFAULT_CONFIG = "config/config.yaml"
QUERY_TIMES = "config/query-times.csv"
#: The recipe of networks that `fields: auto` may come to.
CHOSEN_RECIPE = "pandis-exact"
#: The scale that errors are told at where nothing depends on the device's: no option goes stale.
NOMINAL = {"size": 0.10, "stiffness": 400.0}


class Output(NamedTuple):
    """One output file, the stage (rule, script) that makes it and its wildcards."""

    path: str
    stage: str
    wildcards: dict


def open_plan(config, root, files, aloud=True):
    """Return the plan, or end the process with the configuration's faults in plain words.

    With ``aloud`` it says which meshes are refused, and why: they keep no other from running.
    """
    try:
        plan = Plan(config, root, files)
    except PandisError as error:
        # Snakemake would print a traceback of its own around the message
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    if aloud:
        for mesh, why in plan.refused.items():
            print(f"refused: {mesh}: {why}", file=sys.stderr)
        plan.forget_partial_report()
    return plan


class Plan:
    """The outputs, options and code digests of a configuration.

    Parameters
    ----------
    config : dict
        The parsed configuration.
    root : path-like
        Folder of the Snakefile and of the package ``pandis``.
    files : iterable of path-like
        The configuration files, to be checked for doubled keys.

    Raises
    ------
    PandisError
        The configuration has faults; all are listed.
    """

    def __init__(self, config, root, files=()):
        # as a user would write them: relative where they lie below the working directory
        self.files = [os.path.relpath(path) for path in files]
        for path in self.files:
            check_yaml(path)
        #: Where everything lies that a run makes.
        self.folder = results_folder(config)
        #: Meshes that cannot be built, and why: their own job says so, and ends the run with 1.
        self.refused = {}
        self.entries = self._buildable(load_config(config, self.refused))
        self.scenes = load_scenes(config, self.entries)
        #: What scenes need alone; without scenes, everything.
        self.needed = needed(self.entries, self.scenes)
        self.digests = CodeDigests(root)
        self.sources = SourceDigests()
        self._options, self._codes = {}, {}
        self._start = time.time()

    def _buildable(self, entries):
        """Return the meshes whose source is there and of a known format; note the others."""
        good = {}
        for mesh, entry in entries.items():
            fault = source_fault(entry.source)
            if fault is None:
                good[mesh] = entry
            else:
                self.refused[mesh] = f"meshes.{mesh}.{fault}"
        if not good:
            lines = "\n".join(f"  {why}" for why in self.refused.values())
            raise PandisError(f"no mesh can be built:\n{lines}")
        return good

    @property
    def summary(self):
        """Path of the table of the whole run."""
        return f"{self.folder}/summary.csv"

    @property
    def report(self):
        """Path of the page of the whole run."""
        return f"{self.folder}/report.html"

    @property
    def final(self):
        """The outputs that all meshes share."""
        return Output(self.summary, "summary", {}), Output(self.report, "report", {})

    #: The table of query times that `fields: auto` goes by; `snakemake calibrate` renews it.
    query_times = QUERY_TIMES

    @property
    def meshes(self):
        """Names of the meshes, in the order of the file."""
        return list(self.entries)

    @property
    def recipes(self):
        """Names of all recipes that some mesh trains."""
        entries = [*self.entries.values(), *self.needed.values()]
        specs = (spec for entry in entries for spec in _held(entry))
        return sorted({spec.name for spec in specs if spec.kind == "network"})

    def specs(self, mesh):
        """Return the FieldSpec of every field of a mesh."""
        return _specs(self.entries[mesh])

    def held(self, mesh):
        """Return one FieldSpec for each artifact that holds a field, but for the mesh itself.

        A contact point's field is among them.
        """
        return _held(self.entries[mesh])

    # --- outputs ---------------------------------------------------------------

    def outputs(self, mesh, entry=None):
        """Return every output of a mesh, each path once, in building order.

        ``entry`` stands in for the mesh's own, with other fields.
        """
        entry = entry or self.entries[mesh]
        home, made = f"{self.folder}/{mesh}", []

        def add(path, stage, **wildcards):
            made.append(Output(f"{home}/{path}", stage, {"mesh": mesh} | wildcards))

        extension = url_extension(entry.source)
        if extension:
            add(f"source.{extension}", "fetch", extension=extension)
        add("mesh.zarr.zip", "mesh")
        specs, held = _specs(entry), _held(entry)
        if any(spec.kind == "network" for spec in held):
            add("samples.zarr.zip", "sample")
        for spec in held:
            if spec.kind == "network":
                add(f"{spec.artifact}.zarr.zip", "train", recipe=spec.name)
        for spec in specs:
            if spec.kind == "network":
                for ending in ("onnx", "pt2"):
                    add(f"export/{spec.name}.{ending}", "export_network", recipe=spec.name)
        for spec in held:
            path, content = f"{spec.artifact}.zarr.zip", GRID_FIELDS.get(spec.kind)
            if spec.kind == AUTO:
                add(path, "choose")
            if spec.kind in PLANE_FIELDS:
                add(path, "support_planes")
            if content is None:
                continue
            if spec.size == "auto":
                add(path, "bake_auto", kind=spec.kind)
            elif content == "spline":
                add(path, "bake_spline", size=str(spec.size))
            else:
                add(path, "bake", content=content, size=str(spec.size))
        for spec in specs:
            if spec.kind not in GRID_FIELDS:
                continue
            if "onnx" in spec.exports:
                add(f"export/{spec.name}.onnx", "export_grid", field=spec.name)
            if entry.bake.vti:
                add(f"export/{spec.name}.vti", "export_vti", field=spec.name)
        for spec in specs:
            if spec.native:
                add(f"export/{spec.name}.pandis", "export_native", name=spec.name)
        add("trajectory.zarr.zip", "trajectory")
        add("evaluation.zarr.zip", "evaluate")
        add("stress.zarr.zip", "stress")
        add("timing.zarr.zip", "timing")
        add("hardware.zarr.zip", "validate")
        add("hardware.json", "validate")
        return made

    def target(self, name):
        """Return the files of a named target; ``all`` lists every file there is.

        All of them, because Snakemake takes a missing intermediate file for
        no reason to run: after a failure it would otherwise find nothing to
        do, over results of older options.
        """
        if name not in TARGETS:
            return [output.path for output in self.everything()]
        every = [output for mesh in self.entries for output in self.outputs(mesh)]
        every += self.scene_outputs()
        wanted = [o.path for o in every if o.stage in TARGETS[name]]
        return wanted + [o.path for o in self.refusals() if name != "scenes"]

    def everything(self):
        """Return every output of this configuration: with scenes, what they need alone."""
        every = [o for mesh, entry in self.needed.items() for o in self.outputs(mesh, entry)]
        if not self.scenes:
            return [*every, *self.refusals(), *self.final]
        return [*(o for o in every if o.stage in SCENE_STAGES), *self.scene_outputs()]

    def refusals(self):
        """Return the outputs that meshes stand for that cannot be built: none is ever made."""
        return [
            Output(f"{self.folder}/{mesh}/refused", "refuse", {"mesh": mesh})
            for mesh in self.refused
        ]

    def scene_outputs(self):
        """Return the outputs of all scenes."""
        return [
            Output(f"{self.folder}/scenes/{scene}.{ending}", "scene", {"scene": scene})
            for scene in self.scenes
            for ending in ("zarr.zip", "json", "h")
        ]

    # --- inputs of rules ---------------------------------------------------------

    def source(self, wildcards):
        """Return the files that a mesh is read from: its own, and those that it names."""
        source = self.entries[wildcards.mesh].source
        extension = url_extension(source)
        if extension:
            return [f"{self.folder}/{wildcards.mesh}/source.{extension}"]
        if source.startswith((SHIPPED, ANALYTIC)):
            return []
        return [os.path.relpath(path) if not Path(source).is_absolute() else str(path)
                for path in self.sources.files(Path(source))]  # fmt: skip

    def source_digest(self, wildcards):
        """Return the SHA-256 of the source set of a mesh; of a URL what it must be."""
        entry = self.entries[wildcards.mesh]
        if url_extension(entry.source):
            return entry.sha256.lower()
        return self.sources.of(entry.source)

    def field_artifacts(self, wildcards):
        """Return the artifacts of all fields of a mesh but its own mesh file."""
        held = self.held(wildcards.mesh)
        return [f"{self.folder}/{wildcards.mesh}/{spec.artifact}.zarr.zip" for spec in held]

    def grid_artifact(self, wildcards):
        """Return the grid that a grid field is exported from."""
        spec = parse_field(wildcards.field, ())
        return f"{self.folder}/{wildcards.mesh}/{spec.artifact}.zarr.zip"

    def native_artifact(self, wildcards):
        """Return the artifact that holds a field of a mesh."""
        spec = parse_field(wildcards.name, self.entries[wildcards.mesh].train)
        return f"{self.folder}/{wildcards.mesh}/{spec.artifact}.zarr.zip"

    def native(self, wildcards):
        """Return the files for ``pandis.h`` of a mesh."""
        specs = [spec for spec in self.specs(wildcards.mesh) if spec.native]
        return [f"{self.folder}/{wildcards.mesh}/export/{spec.name}.pandis" for spec in specs]

    def scene_fields(self, wildcards):
        """Return the files for ``pandis.h`` of the objects of a scene, each once."""
        objects = self.scenes[wildcards.scene].objects.values()
        files = (f"{self.folder}/{own.mesh}/export/{own.field}.pandis" for own in objects)
        return list(dict.fromkeys(files))

    def unexported(self, wildcards):
        """Return the artifacts of the fields that are timed from the library itself."""
        stems = [s.artifact for s in self.specs(wildcards.mesh) if not s.exports]
        stems = [stem for stem in dict.fromkeys(stems) if stem != "mesh"]
        return [f"{self.folder}/{wildcards.mesh}/{stem}.zarr.zip" for stem in stems]

    def exports(self, wildcards):
        """Return the exported files of a mesh."""
        return [
            f"{self.folder}/{wildcards.mesh}/export/{spec.name}.{ending}"
            for spec in self.specs(wildcards.mesh)
            for ending in spec.exports
        ]

    def programs(self, wildcards):
        """Return the PyTorch programs that are timed from C++."""
        specs = [s for s in self.specs(wildcards.mesh) if s.kind == "network"]
        wanted = self.entries[wildcards.mesh].timing.libtorch
        return [f"{self.folder}/{wildcards.mesh}/export/{s.name}.pt2" for s in specs if wanted]

    def report_artifacts(self, only=None):
        """Return everything that the report reads, of all meshes or of one."""
        found = []
        for mesh in [only] if only else self.entries:
            stems = ["mesh", "trajectory", "evaluation", "stress", "timing", "hardware"]
            stems += [spec.artifact for spec in self.held(mesh)]
            if any(spec.kind == "network" for spec in self.held(mesh)):
                stems.append("samples")
            found += [f"{self.folder}/{mesh}/{stem}.zarr.zip" for stem in dict.fromkeys(stems)]
        return found

    def results(self, stem):
        """Return one file of every mesh."""
        return [f"{self.folder}/{mesh}/{stem}" for mesh in self.entries]

    # --- params of rules ---------------------------------------------------------

    def code(self, stage):
        """Return the function that gives a job of ``stage`` the digest of its code.

        The script and the library modules behind it, but for those that the job's options leave
        out: a method that a mesh does not use makes none of its results stale.
        """
        return partial(self._job_code, stage)

    def _job_code(self, stage, wildcards):
        key = stage, unused_modules(self.options(stage)(wildcards))
        if key not in self._codes:
            self._codes[key] = self.digests.stage(*key)
        return self._codes[key]

    def options(self, stage):
        """Return the function that gives a job of ``stage`` its options (Snakemake calls it)."""
        return partial(self._job_options, stage)

    def _job_options(self, stage, wildcards):
        key = (stage, *sorted((k, str(v)) for k, v in dict(wildcards).items()))
        if key not in self._options:
            self._options[key] = plain(self.stage_options(stage, **dict(wildcards)))
        return self._options[key]

    def stage_options(self, stage, mesh=None, **wildcards):
        """Return what one stage of one mesh is asked, and nothing else, as a dict."""
        if stage == "verify":
            return {"configfiles": self.files}
        if stage == "calibrate":
            return {"table": self.query_times}
        if stage == "scene":
            return scene_options(self.scenes[wildcards["scene"]], self.entries)
        if mesh is None:
            return {"fields": {name: entry.fields for name, entry in self.entries.items()}}
        if stage == "refuse":
            return {"why": self.refused[mesh]}
        entry = self.entries[mesh]
        seed = stage_seed(entry.seed, mesh, stage)
        size, stiffness = entry.device.size, entry.device.stiffness
        band = [entry.bake.inside, entry.bake.outside]
        match stage:
            case "fetch":
                return {"url": entry.source, "sha256": entry.sha256}
            case "mesh":
                source = {"source": entry.source, "sha256": entry.sha256}
                return source | entry.mesh.model_dump() | {"seed": seed}
            case "sample":
                return entry.samples.model_dump() | {"seed": seed}
            case "train":
                recipe = wildcards["recipe"]
                seed = stage_seed(entry.seed, mesh, stage, recipe)
                own = recipe_options(entry, recipe) | {"recipe": recipe, "seed": seed}
                return own | ({"size": size, "stiffness": stiffness} if _asks(own) else {})
            case "bake":
                grid = {"content": wildcards["content"], "size": int(wildcards["size"])}
                return grid | {"band": band, "chunk": entry.bake.chunk}
            case "bake_spline":
                return {"size": int(wildcards["size"]), "band": band, "seed": seed}
            case "support_planes":
                return {}
            case "bake_auto":
                kind = wildcards["kind"]
                own = entry.bake.auto[kind].model_dump() | {
                    "kind": kind,
                    "band": band,
                    "seed": seed,
                }
                return own | ({"size": size, "stiffness": stiffness} if _asks(own) else NOMINAL)
            case "choose":
                recipe = recipe_options(entry, CHOSEN_RECIPE) | {"recipe": CHOSEN_RECIPE}
                law = entry.samples.model_dump()
                own = {"budget": entry.budget.model_dump(), "recipe": recipe, "samples": law}
                own["stress"] = entry.stress.model_dump() | {"size": size, "stiffness": stiffness}
                own["weight_bits"] = entry.export.weight_bits
                return own | {"band": band, "seed": seed}
            case "export_network":
                return {"field": wildcards["recipe"]}
            case "export_grid" | "export_vti":
                return {"field": wildcards["field"]}
            case "export_native":
                return {"field": wildcards["name"]} | entry.export.model_dump()
            case "trajectory":
                return entry.trajectory.model_dump() | {"seed": seed}
            case "evaluate":
                several = entry.evaluation.paths > 1
                return {
                    **entry.evaluation.model_dump(),
                    "trajectory": entry.trajectory.model_dump() if several else None,
                    "fields": entry.fields,
                    "seed": seed,
                    "size": size,
                    "stiffness": stiffness,
                }
            case "stress":
                own = {"fields": entry.fields, "seed": seed, "size": size, "stiffness": stiffness}
                return entry.stress.model_dump() | own
            case "timing":
                own = [spec.name for spec in self.specs(mesh) if not spec.exports]
                return entry.timing.model_dump() | {"in_python": own}
            case "validate":
                own = ("hand_stiffness", "hand_damping", "press", "delay")
                hand = {key.removeprefix("hand_"): getattr(entry.stress, key) for key in own}
                return {
                    **entry.hardware.model_dump(),
                    "hand": hand,
                    "fields": [spec.name for spec in self.specs(mesh) if spec.native],
                    "size": size,
                    "stiffness": stiffness,
                    "seed": seed,
                }
        raise KeyError(stage)

    # --- the last words of a run ---------------------------------------------------

    def farewell(self):
        """Return what a successful run prints at its end."""
        if self.scenes:
            return f"\nThe scenes are in  {self.folder}/scenes/"
        if not Path(self.report).is_file() or Path(self.report).stat().st_mtime < self._start:
            return "Done. The report is made by the targets all and report."
        return (
            f"\nThe report is in   {self.report}\n"
            f"The table is in    {self.summary}\n"
            f"Exported fields:   {self.folder}/{{mesh}}/export/"
        )

    def condolence(self):
        """Return what a failed run prints at its end."""
        return (
            "\nA job failed, or was stopped; its own message stands above, after 'error:' or in a "
            "traceback.\n"
            f"All logs are in    {self.folder}/logs/\n"
            "Other meshes went on. Mend the cause and run the same command again: only what is "
            "missing or stale runs."
        )

    # --- a report without the meshes that failed -----------------------------------

    @property
    def partial_note(self):
        """Path of the list of meshes that the report leaves out; there while it does."""
        return Path(self.folder) / "refused.json"

    def forget_partial_report(self):
        """See to it that a report that leaves meshes out is made anew, however it was copied."""
        if self.partial_note.is_file():
            for path in (self.report, self.summary):
                if Path(path).is_file():
                    os.utime(path, (1, 1))  # older than everything that it is made from

    def partial_report(self, workflow):
        """Write the report and the summary of the meshes that are whole, after a failed run.

        In a process of its own, for planning loads no numerics. What is written is no result of
        Snakemake's: it is older than all its inputs, and its records go.

        Parameters
        ----------
        workflow : snakemake.workflow.Workflow
            Whose run has failed; only if it would have made the report, and nobody stopped it.
        """
        final = [job for job in workflow.dag.jobs if job.rule.name in ("report", "summary")]
        if not any(job.rule.name == "report" for job in final):
            return
        given = {"config": workflow.config, "root": str(self.digests.root), "files": self.files}
        given["since"] = self._start
        command = [sys.executable, "-m", "pandis.report.partial"]
        done = subprocess.run(
            command,
            input=json.dumps(given, default=str),
            text=True,
            env=os.environ | {"PYTHONPATH": str(self.digests.root)},
            check=False,
        )
        if done.returncode == 0:
            for made in (path for job in final for path in job.output):
                workflow.persistence.cleanup_metadata(made)
            self.forget_partial_report()

    def train_threads(self, wildcards):
        """Return the threads that a recipe trains with: a part of its options."""
        return self.entries[wildcards.mesh].train[wildcards.recipe].threads

    def train_gpus(self, wildcards):
        """Return how many GPUs a recipe claims."""
        return int(self.entries[wildcards.mesh].train[wildcards.recipe].device != "cpu")


def _asks(options):
    """Tell whether a field is asked for by its error, which depends on the device's scale."""
    return options.get("force_error") is not None


def _specs(entry):
    """Return the FieldSpec of every field of a mesh's options."""
    return [parse_field(name, entry.train) for name in entry.fields]


def _held(entry):
    """Return one FieldSpec for each artifact that holds a field, but for the mesh itself."""
    specs = [spec.through or spec for spec in _specs(entry)]
    return [s for s in {s.artifact: s for s in specs}.values() if s.artifact != "mesh"]


def stage_seed(root, *names):
    """Return the seed of a stage: a hash of the configuration's seed and the names."""
    text = "\0".join([str(root), *names])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "little")

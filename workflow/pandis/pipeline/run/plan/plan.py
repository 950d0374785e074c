"""The plan of a run: every output of a configuration, and the params and inputs of each rule.

The Snakefile makes one `Plan`. Rules take their params and inputs from it, targets
take their file lists, and `verify` compares it with the files in results/. Planning
imports neither torch nor trimesh.
"""

import os
import time
from functools import cached_property, partial
from pathlib import Path

from pandis.base.errors import ConfigError, PandisError
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.config import plain
from pandis.pipeline.run.ask.faults import raise_faults
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.outputs import distance_fields, field_holders, field_specs
from pandis.pipeline.run.ask.reading import check_yaml, last_target, load_config, results_folder
from pandis.pipeline.run.ask.recipes import budgeted
from pandis.pipeline.run.ask.sourcing import (
    ANALYTIC,
    SHIPPED,
    SourceDigests,
    source_fault,
    url_extension,
)
from pandis.pipeline.run.ask.tasks import CalibrateTask, RefuseTask, SummaryTask, VerifyTask
from pandis.pipeline.run.job.provenance import CodeDigests, needs
from pandis.pipeline.run.plan.datasets import Datasets
from pandis.pipeline.run.plan.placing import all_faults, load_scenes, needed, scene_task
from pandis.pipeline.run.plan.stages import STAGES, Output, PlannedJob

#: Named targets of the stages and of the scenes.
TARGETS = {*(row.target for row in STAGES.values() if row.target), "scenes", "datasets"}
#: Targets that `until: exports` leaves out: fields are not measured, stressed or timed.
JUDGING = ("evaluations", "hardware")
#: Targets that `until: meshes` and `until: samples` make; None is that of downloads.
FIRST = {"meshes": (None, "meshes"), "samples": (None, "meshes", "samples")}
DEFAULT_CONFIG = "config/config.yaml"
QUERY_TIMES = "config/query-times.csv"


class Plan:
    """The outputs, options and code digests of a configuration.

    Parameters
    ----------
    config : dict
        The parsed configuration.
    folder : path-like
        Folder that contains the Snakefile.
    files : iterable of path-like
        The configuration files, to be checked for duplicate keys.
    store : str
        The object store that contains the results folder; empty if results are local files.

    Raises
    ------
    PandisError
        The configuration has faults; the message lists all of them.
    """

    def __init__(self, config, folder, files=(), *, store=""):
        self.config = config
        # as a user would write them: relative to the working directory
        self.files = [os.path.relpath(path) for path in files]
        for path in self.files:
            check_yaml(path)
        self.sources = SourceDigests()
        #: For each mesh that cannot be built, the reason. Its job reports the reason and fails.
        self.refused = {}
        try:
            #: Folder of all outputs of a run.
            self.folder = results_folder(config)
            #: Named target that the run ends with; None if it makes everything.
            self.until = last_target(config)
            self.entries = self._buildable(load_config(config, self.refused))
            self.scenes = load_scenes(config, self.entries)
            self.datasets = Datasets(config, self.folder, digests=self.sources)
        except ConfigError as error:
            raise_faults(error.faults | all_faults(config, self.sources))
        #: Only the meshes and fields that scenes need; without scenes, all.
        self.needed = needed(self.entries, self.scenes)
        self.digests = CodeDigests(folder)
        self._options, self._codes = {}, {}
        self.store = store
        #: When planning began, seconds since the epoch.
        self.start = time.time()

    def _buildable(self, entries):
        """Return the meshes whose source exists in a known format; add the rest to `refused`."""
        good = {}
        for mesh, entry in entries.items():
            fault = source_fault(entry.source)
            if fault is None:
                good[mesh] = entry
            else:
                self.refused[mesh] = f"meshes.{mesh}.{fault}"
        if self.refused and not good:
            lines = "\n".join(f"  {why}" for why in self.refused.values())
            raise PandisError(f"no mesh can be built:\n{lines}")
        return good

    @property
    def summary(self):
        """Path of the table that covers the whole run."""
        return f"{self.folder}/{'collection' if self.until else 'summary'}.csv"

    @property
    def report(self):
        """Path of the page that covers the whole run."""
        return f"{self.folder}/{'collection' if self.until else 'report'}.html"

    @property
    def final(self):
        """The outputs that cover the whole run."""
        if not self.entries:  # there are only data sets, which have cards
            return ()
        makers = ("collection", "collection") if self.until else ("summary", "report")
        return Output(self.summary, makers[0], {}), Output(self.report, makers[1], {})

    @property
    def query_times(self):
        """Path of the table of query times that `fields: auto` uses.

        A table that `snakemake -j1 -f calibrate` wrote to the working directory replaces the
        shipped default.
        """
        shipped = self.digests.scripts.parent / QUERY_TIMES
        return QUERY_TIMES if Path(QUERY_TIMES).is_file() else os.path.relpath(shipped)

    @property
    def meshes(self):
        """Names of the meshes, in the order of the file."""
        return list(self.entries)

    @property
    def recipes(self):
        """Names of all recipes that are trained on at least one mesh."""
        return sorted({spec.name for spec in self._holders.values() if spec.learned})

    @property
    def baked(self):
        """Stems of all artifacts that contain a field and are built from a mesh alone."""
        specs = (spec for spec in self._holders.values() if not spec.learned)
        return sorted({spec.artifact for spec in specs if spec.kind != AUTO})

    @cached_property
    def _holders(self):
        """One FieldSpec for each artifact that contains a field, by mesh and stem."""
        entries = [*self.entries.items(), *self.needed.items()]
        return {(mesh, s.artifact): s for mesh, entry in entries for s in field_holders(entry)}

    def specs(self, mesh):
        """Return the FieldSpec of every field of a mesh."""
        return field_specs(self.entries[mesh])

    def holders(self, mesh):
        """Return one FieldSpec for each artifact that contains a field, except the mesh itself.

        A tracked contact point is represented by the field on which it is tracked.
        """
        return field_holders(self.entries[mesh])

    # --- outputs ---------------------------------------------------------------

    def outputs(self, mesh, entry=None):
        """Return every output of a mesh, each path once, in build order.

        ``entry``, if given, replaces the mesh's options, because a scene may need other fields.
        """
        entry = entry or self.entries[mesh]
        return [
            Output(f"{self.folder}/{mesh}/{path}", stage, {"mesh": mesh} | wildcards)
            for stage, row in STAGES.items()
            for path, wildcards in row.outputs(entry)
        ]

    def target(self, name):
        """Return the files of a named target; ``all`` lists every file.

        Intermediate files are listed, too: a missing one alone does not make Snakemake run a
        job. If they were not listed, Snakemake would find nothing to do after a failure, even
        if the existing results were made with older options.
        """
        if name not in TARGETS:
            return [output.path for output in self.everything()]
        if name == "datasets":
            return [output.path for output in self.datasets.outputs()]
        every = [output for mesh in self.entries for output in self.outputs(mesh)]
        every += self.scene_outputs()
        if name == "samples":  # asked for by name, they need no network
            every += [self._samples(mesh) for mesh in self.entries]
        paths = list(dict.fromkeys(o.path for o in every if _target(o.stage) == name))
        return paths + [o.path for o in self.refusals() if name != "scenes"]

    def everything(self):
        """Return the configuration's outputs; with scenes, only theirs and those that they need."""
        every = [o for mesh, entry in self.needed.items() for o in self.outputs(mesh, entry)]
        if self.until == "samples":
            every += [self._samples(mesh) for mesh in self.needed]
        if self.until:
            every = list({o.path: o for o in every if self._comes(o.stage)}.values())
        if not self.scenes:
            return [*every, *self.datasets.outputs(), *self.refusals(), *self.final]
        return [*(o for o in every if STAGES[o.stage].in_scenes), *self.scene_outputs()]

    def _samples(self, mesh):
        return Output(f"{self.folder}/{mesh}/samples.zarr.zip", "sample", {"mesh": mesh})

    def _comes(self, stage):
        """Return whether a stage runs if the run ends with `until`."""
        target = STAGES[stage].target
        return target not in JUDGING if self.until == "exports" else target in FIRST[self.until]

    def refusals(self):
        """For each mesh that cannot be built, return an output that is never made."""
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
        """Return the source file of a mesh and the files that it refers to."""
        source = self.entries[wildcards.mesh].source
        extension = url_extension(source)
        if extension:
            return [f"{self.folder}/{wildcards.mesh}/source.{extension}"]
        if source.startswith((SHIPPED, ANALYTIC)):
            return []
        return [os.path.relpath(path) if not Path(source).is_absolute() else str(path)
                for path in self.sources.files(Path(source))]  # fmt: skip

    def source_digest(self, wildcards):
        """Return the SHA-256 of the source set of a mesh; for a URL, the configured one."""
        entry = self.entries[wildcards.mesh]
        if url_extension(entry.source):
            return entry.sha256.lower()
        return self.sources.of(entry.source)

    def field_files(self, wildcards):
        """Return the files from which the fields of a mesh are queried."""
        return self._answering(wildcards.mesh, self.specs(wildcards.mesh))

    def _answering(self, mesh, specs):
        """Return each field's file for ``pandis.h``, or its artifact if it has no such file."""
        names = [f"export/{spec.name}.pandis" if spec.native else f"{spec.artifact}.zarr.zip"
                 for spec in specs if spec.native or spec.artifact != "mesh"]  # fmt: skip
        return [f"{self.folder}/{mesh}/{name}" for name in dict.fromkeys(names)]

    def field_artifact(self, wildcards):
        """Return the artifact that contains a field of a mesh."""
        spec = parse_field(wildcards.field, self.entries[wildcards.mesh].train)
        return f"{self.folder}/{wildcards.mesh}/{spec.artifact}.zarr.zip"

    def native(self, wildcards):
        """Return a mesh's files for ``pandis.h``."""
        specs = [spec for spec in self.specs(wildcards.mesh) if spec.native]
        return [f"{self.folder}/{wildcards.mesh}/export/{spec.name}.pandis" for spec in specs]

    def distance_files(self, wildcards):
        """Return the files for ``pandis.h`` of those fields of a mesh that may have distances."""
        folder = f"{self.folder}/{wildcards.mesh}/export"
        specs = distance_fields(self.entries[wildcards.mesh])
        return [f"{folder}/{spec.name}.pandis" for spec in specs]

    def scene_fields(self, wildcards):
        """Return the files for ``pandis.h`` of the objects of a scene, each once."""
        objects = scene_task(self.scenes[wildcards.scene], self.entries).objects
        pairs = [(p.mesh, name) for p in objects for name in (p.field, p.beside) if name]
        files = (f"{self.folder}/{mesh}/export/{field}.pandis" for mesh, field in pairs)
        return list(dict.fromkeys(files))

    def unexported(self, wildcards):
        """Return the files of the fields that are timed from Python."""
        specs = [spec for spec in self.specs(wildcards.mesh) if "onnx" not in spec.exports]
        return self._answering(wildcards.mesh, specs)

    def exports(self, wildcards):
        """Return the ONNX graphs of a mesh."""
        return self._ending(wildcards.mesh, "onnx")

    def programs(self, wildcards):
        """Return the PyTorch programs that are timed from C++."""
        timed = self.entries[wildcards.mesh].timing.libtorch
        return self._ending(wildcards.mesh, "pt2") if timed else []

    def _ending(self, mesh, ending):
        names = (spec.name for spec in self.specs(mesh) if ending in spec.exports)
        return [f"{self.folder}/{mesh}/export/{name}.{ending}" for name in names]

    def report_artifacts(self, only=None):
        """Return the files that the report or a collection's table reads, for all meshes or one."""
        paths = []
        for mesh in [only] if only else self.entries:
            if self.until:
                exported = self.until == "exports"
                native = (spec.name for spec in self.specs(mesh) if spec.native and exported)
                paths += [f"{self.folder}/{mesh}/mesh.zarr.zip"]
                paths += [f"{self.folder}/{mesh}/export/{name}.pandis" for name in native]
                continue
            stems = ["mesh", "trajectory", "evaluation", "stress", "timing", "hardware"]
            stems += [spec.artifact for spec in self.holders(mesh)]
            if any(spec.learned for spec in self.holders(mesh)):
                stems.append("samples")
            paths += [f"{self.folder}/{mesh}/{stem}.zarr.zip" for stem in dict.fromkeys(stems)]
            names = (spec.name for spec in distance_fields(self.entries[mesh]))
            paths += [f"{self.folder}/{mesh}/export/{name}.pandis" for name in names]
        return paths

    def results(self, stem):
        """Return the path of the file ``stem`` of every mesh."""
        return [f"{self.folder}/{mesh}/{stem}" for mesh in self.entries]

    # --- params of rules ---------------------------------------------------------

    def code(self, stage):
        """Return a function that returns the code digest of a job of ``stage``.

        The digest covers the script and its library modules, except those that the job's options
        do not need. So a change to code that a mesh does not use makes none of its results stale.
        """
        return partial(self._job_code, stage)

    def _job_code(self, stage, wildcards):
        key = stage, needs(self.options(stage)(wildcards))
        if key not in self._codes:
            name, needed = key
            self._codes[key] = self.digests.stage(name, needed)
        return self._codes[key]

    def options(self, stage):
        """Return a function that Snakemake calls for the options of a job of ``stage``."""
        return partial(self._job_options, stage)

    def _job_options(self, stage, wildcards):
        key = (stage, *sorted((k, str(v)) for k, v in dict(wildcards).items()))
        if key not in self._options:
            self._options[key] = plain(self.stage_options(stage, **dict(wildcards)))
        return self._options[key]

    def stage_options(self, stage, mesh=None, **wildcards):
        """Return the options of one stage of one mesh: see `pandis.pipeline.run.ask.tasks`."""
        if stage == "verify":
            return VerifyTask(configfiles=self.files, store=self.store)
        if stage == "calibrate":
            return CalibrateTask(table=QUERY_TIMES)
        if stage == "scene":
            return scene_task(self.scenes[wildcards["scene"]], self.entries)
        if stage in ("shard", "dataset"):
            return getattr(self.datasets, stage)(**wildcards)
        if mesh is None:
            return SummaryTask(fields={name: entry.fields for name, entry in self.entries.items()})
        if stage == "refuse":
            return RefuseTask(why=self.refused[mesh])
        stem = wildcards.get("artifact") or f"model-{wildcards.get('recipe')}"
        built = self._holders.get((mesh, stem))
        return STAGES[stage].options(PlannedJob(stage, mesh, self.entries[mesh], wildcards, built))

    def train_threads(self, wildcards):
        """Return the number of threads with which a recipe trains, as set in its options."""
        return self.entries[wildcards.mesh].train[wildcards.recipe].threads

    def train_priority(self, wildcards):
        """Return the priority of a training job: the longest starts first, as others wait for it.

        The priority is the number of steps, or ten times the seconds of a time budget.
        """
        return self._train_priority(wildcards.mesh, wildcards.recipe)

    def sample_priority(self, wildcards):
        """Return the priority of a sampling job: that of the longest training on its points."""
        mesh = wildcards.mesh
        learned = (spec.name for spec in self.holders(mesh) if spec.learned)
        return max((self._train_priority(mesh, name) for name in learned), default=0)

    def _train_priority(self, mesh, recipe):
        recipe = budgeted(self.entries[mesh].train[recipe])
        return recipe.steps or int(10 * recipe.seconds)

    def train_gpus(self, wildcards):
        """Return the number of GPUs that a recipe's training reserves: 0 or 1."""
        return int(self.entries[wildcards.mesh].train[wildcards.recipe].device != "cpu")


def _target(stage):
    """Return the named target that a stage's outputs belong to."""
    return STAGES[stage].target if stage in STAGES else f"{stage}s"

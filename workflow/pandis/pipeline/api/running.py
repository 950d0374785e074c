"""Runs stages of the workflow in the caller's process, one mesh at a time.

The scripts, options and provenance are those of the workflow, so the files are the same to the
byte.
"""

import re
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

from pandis.base.errors import ConfigError, PandisError, RepairError
from pandis.base.workflow import workflow_folder
from pandis.pipeline.api.sources import source_of
from pandis.pipeline.api.writing import mesh_bytes
from pandis.pipeline.run.ask.catalogue import MESH_NAME, parse_field
from pandis.pipeline.run.ask.config import MeshEntry, plain
from pandis.pipeline.run.ask.faults import raise_faults, stage_faults
from pandis.pipeline.run.ask.outputs import field_holders
from pandis.pipeline.run.ask.sourcing import SourceDigests, source_files, source_path
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.pipeline.run.job.provenance import CodeDigests, combine, needs
from pandis.pipeline.run.job.stage import here
from pandis.pipeline.run.plan.stages import STAGES, PlannedJob

#: A stage limits the threads of the process's BLAS while it runs.
_ONE_AT_A_TIME = threading.Lock()
#: Inputs of the stages by name, as in their rules: files of the mesh's folder.
_INPUTS = {
    "mesh": {},
    "sample": {"mesh": "mesh.zarr.zip"},
    "train": {"mesh": "mesh.zarr.zip", "samples": "samples.zarr.zip"},
    "bake": {"mesh": "mesh.zarr.zip"},
    "choose": {"mesh": "mesh.zarr.zip"},
    "export_native": {"mesh": "mesh.zarr.zip"},
}


class _Names(dict):
    """A dict whose values are also attributes, and which lists them, like Snakemake's objects."""

    def __getattr__(self, name):
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None

    def __iter__(self):
        return iter(self.values())


class Script:
    """What a script finds as ``snakemake``: see `pandis.pipeline.run.job.stage.stage`.

    Parameters
    ----------
    script : str
        Name of the stage.
    wildcards : dict of str to str
    outputs : list of Path
    folder : Path
        The results folder.
    options : dict, optional
        Options of the job, as plain data.
    """

    threads, resources, stage, show = 2, {}, staticmethod(here), staticmethod(print)

    def __init__(self, script, wildcards, outputs, *, folder, options=None):
        self.script, self.output = script, [str(path) for path in outputs]
        self.scriptdir = str(workflow_folder().parent / "scripts")
        self.wildcards, self.input = _Names(wildcards), _Names()
        self.params = _Names(options=options)
        self.log = [f"{folder}/logs/{'/'.join(wildcards.values())}/{outputs[0].name}.log"]


def run(script, log):
    """Run a script in this process.

    Raises
    ------
    PandisError
        As from the stage; or a package is missing.
    """
    code = Path(script.scriptdir, f"{script.script}.py")
    script.show = log
    try:
        with _ONE_AT_A_TIME:
            exec(compile(code.read_text(encoding="utf-8"), code, "exec"), {"snakemake": script})
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] == "pandis":
            raise
        raise PandisError(
            f"this needs the package {error.name}: pip install 'pandis-fields[workflow]'"
        ) from None


class Stages:
    """The stages of one mesh, run on demand in a folder of their own.

    Parameters
    ----------
    source : pandis.pipeline.api.sources.Source
    options : dict
        The mesh's options, as in a configuration.
    folder : Path
        An empty folder.
    log : pandis.base.progress.Log
    name : str, optional
        The mesh's name in a configuration; by default that of its file.

    Raises
    ------
    PandisError
        The options have faults; the message lists all of them.
    """

    def __init__(self, source, options, folder, *, log, name=None):
        self.source, self.log, self.mesh = source, log, name or source.name
        complete = {"source": source.text} | options
        raise_faults(stage_faults(MeshEntry, complete))
        self.entry = MeshEntry.model_validate(complete)
        self._results = Path(folder)
        self.folder = self._results / self.mesh
        self._digests = CodeDigests(workflow_folder())

    def artifact(self, stem):
        """Build an artifact of the mesh, unless it exists, and read it."""
        return read_artifact(self.make(f"{stem}.zarr.zip"))

    def make(self, name):
        """Build a file of the mesh's folder, unless it exists, and return its path."""
        path = self.folder / name
        if not path.exists():
            self._run(*self._job(name), path)
        return path

    def _job(self, name):
        """Return the stage that writes a file, and the wildcards of its rule."""
        for stage in _INPUTS:
            outputs = [("samples.zarr.zip", {})] if stage == "sample" else None
            for path, wildcards in outputs or STAGES[stage].outputs(self.entry):
                if path == name:
                    return stage, wildcards
        raise PandisError(f"no stage of these options writes {name}")

    def _run(self, stage, wildcards, path):
        path.parent.mkdir(parents=True, exist_ok=True)
        script = Script(stage, {"mesh": self.mesh} | wildcards, [path], folder=self._results)
        script.input.update(self._inputs(stage, wildcards))
        stem = wildcards.get("artifact") or f"model-{wildcards.get('recipe')}"
        built = {spec.artifact: spec for spec in field_holders(self.entry)}.get(stem)
        planned = PlannedJob(stage, self.mesh, self.entry, wildcards, built)
        options = plain(STAGES[stage].options(planned))
        digest = combine(self._digests.modules(stage, needs(options)))
        script.params.update(options=options, code=digest)
        if stage == "mesh":
            arrays = self.source.arrays is not None
            script.params["source"] = "" if arrays else SourceDigests().of(self.source.text)
        run(script, self.log)

    def _inputs(self, stage, wildcards):
        """Make the inputs of a job, and return their paths by name."""
        if stage == "mesh":
            return dict(enumerate(self._source_files()))
        inputs = {key: str(self.make(name)) for key, name in _INPUTS[stage].items()}
        if stage == "choose":
            inputs["times"] = str(workflow_folder().parent / "config/query-times.csv")
        if stage == "export_native":
            spec = parse_field(wildcards["field"], self.entry.train)
            inputs = {"artifact": str(self.make(f"{spec.artifact}.zarr.zip"))} | inputs
        return inputs

    def _source_files(self):
        """Return the files of the source; arrays are written to one."""
        if self.source.arrays is None:
            path = source_path(self.source.text)
            is_file = path is not None and path == Path(self.source.text)
            return [str(file) for file in source_files(path)] if is_file else []
        path = self.folder / "source.ply"
        path.write_bytes(mesh_bytes("ply", *self.source.arrays))
        return [str(path)]


@contextmanager
def stages(mesh, options, log=None):
    """Yield the `Stages` of a mesh in a temporary folder, which is deleted at the end.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`.
    options : dict of str to dict
        From `pandis.pipeline.api.options.sections`; and ``name``.
    log : pandis.base.progress.Log, optional

    Raises
    ------
    PandisError
        As from the stages. If options would help, the message also names them as arguments.
    """
    options = dict(options)
    name, log = options.pop("name", None), log or (lambda text: None)
    if name is not None and not re.fullmatch(MESH_NAME, str(name)):
        why = f"{name!r} must start with a-z; the rest may be a-z, 0-9, - or _"
        raise ConfigError(f"name: {why}", {"name": why})
    try:
        with tempfile.TemporaryDirectory(prefix="pandis-") as folder:
            yield Stages(source_of(mesh), options, folder, log=log, name=name)
    except RepairError as error:
        if error.option:
            words = ", ".join(f"{key}={value!r}" for key, value in error.option.items())
            error.args = (f"{error} (as arguments: {words})",)
        raise

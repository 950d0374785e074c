"""The fields of one mesh of a data set: builds them, and makes their files for pandis.h."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.mesh.processes import lacks_memory
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kind import SearchTask
from pandis.pipeline.run.ask.kinds import KINDS, build_task, kind_module
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.stages import stage_seed


def field_files(repaired, body, work):
    """Build fields of a mesh, as the stages `bake` and `export_native` do.

    Parameters
    ----------
    repaired : pandis.pipeline.run.job.artifact.Artifact
        The repaired mesh.
    body : pandis.pipeline.geometry.body.Body
    work : pandis.pipeline.dataset.rows.Work

    Returns
    -------
    files : dict of str to bytes
        The ``.pandis`` files, by the fields' names, sorted. Each was compared with the library's
        answers.
    unbuilt : dict of str to str
        Why other fields cannot be built of this mesh.

    Raises
    ------
    PandisError
        Memory is short.
    """
    files, unbuilt, options = {}, {}, NativeOptions(**work.export)
    for name in sorted(work.builds):
        spec, artifact = known_field(name), repaired
        provenance = {"mesh": work.member.name, "field": name, "key": work.key}
        try:
            if work.builds[name]:
                artifact = _built(spec, repaired, work)
            field = open_field(spec, artifact)
            files[name] = export_native(field, body, options, provenance=provenance, log=_silent)
        except PandisError as error:
            if lacks_memory(error):  # more of it may help, so the mesh is tried again then
                raise
            unbuilt[name] = str(error)
    return files, unbuilt


def _silent(text):
    """Drop a line of a log."""


def _built(spec, mesh, work):
    """Return the artifact of a field."""
    kind, options = spec.kind, dict(work.builds[spec.name])
    if "seed" in options:
        options["seed"] = stage_seed(work.seed, work.member.name, *KINDS[kind].stream(spec))
    job = _Job(build_task(**options), mesh)
    searched = isinstance(job.options, SearchTask)
    # both names are literal, so that the code on which a shard depends can be told
    module = kind_module(kind, "search") if searched else kind_module(kind, "build")
    module.build(job)
    return job.artifact


class _Job:
    """A running `bake` whose output stays in memory: see `pandis.pipeline.run.job.stage.Job`."""

    log, progress = staticmethod(_silent), staticmethod(silent_progress)

    def __init__(self, options, mesh):
        self.options, self.artifact, self._mesh = options, None, mesh

    def read(self, name, kind):
        """Return the mesh."""
        del name, kind
        return self._mesh

    def write(self, kind, arrays, attributes):
        """Keep the output."""
        self.artifact = Artifact(kind, arrays, attributes)

    def write_pieces(self, kind, columns, pieces, *, attributes):
        """Keep the output, whose pieces are joined."""
        pieces = list(pieces)
        arrays = {name: np.concatenate([piece[name] for piece in pieces]) for name in columns}
        self.write(kind, arrays, attributes)

"""The fields of one mesh of a data set: builds them, and makes their files for pandis.h."""

from functools import lru_cache

import numpy as np

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.config import MeshEntry
from pandis.pipeline.run.ask.kind import SearchTask
from pandis.pipeline.run.ask.kinds import KINDS, kind_module
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.stages import PlannedJob


def field_files(repaired, names, *, name, seed, key):
    """Build fields of a mesh with default options, as the stages `bake` and `export_native` do.

    Parameters
    ----------
    repaired : pandis.pipeline.run.job.artifact.Artifact
        The repaired mesh.
    names : sequence of str
        Names of fields that need no training.
    name : str
        The mesh's name in its data set.
    seed : int
        Root of all random numbers.
    key : str
        Digest of everything that the files depend on.

    Returns
    -------
    dict of str to bytes
        The ``.pandis`` files, by the fields' names, sorted. Each was compared with the library's
        answers.

    Raises
    ------
    PandisError
        A field cannot be built of this mesh.
    """
    body, entry, files = Body.open(repaired), _entry(seed), {}
    for spec in map(known_field, sorted(names)):
        artifact = repaired
        if spec.artifact != "mesh":
            artifact = _built(PlannedJob("bake", name, entry, {}, spec), repaired)
        files[spec.name] = export_native(
            open_field(spec, artifact), body, entry.export,
            provenance={"mesh": name, "field": spec.name, "key": key}, log=_silent,
        )  # fmt: skip
    return files


@lru_cache(4)
def _entry(seed):
    """Return the default options of a mesh."""
    return MeshEntry(source="", seed=seed)


def _silent(text):
    """Drop a line of a log."""


def _built(planned, mesh):
    """Return the artifact of a planned field."""
    kind = planned.built.kind
    job = _Job(KINDS[kind].options(planned, planned.built), mesh)
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

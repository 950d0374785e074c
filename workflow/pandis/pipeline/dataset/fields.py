"""The fields of one mesh of a data set: builds them, and makes their files for pandis.h."""

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.dataset.reading import MESH, split_files
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kind import SearchTask
from pandis.pipeline.run.ask.kinds import KINDS, build_task, kind_module
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.stages import stage_seed


def missing_fields(work, facts):
    """Return the names of the fields of a task that a mesh with rows lacks, sorted.

    A field that lacked time or memory is missing once the limits are others.

    Parameters
    ----------
    work : pandis.pipeline.dataset.rows.Work
    facts : pandis.pipeline.run.records.dataset.MeshFacts
    """
    keys = {} if facts.failed else work.field_keys or {}
    return [name for name in sorted(keys) if facts.field_keys.get(name)
            not in (keys[name], _limited_key(work, name))]  # fmt: skip


def _limited_key(work, name):
    """Return the key of a field that cannot be built within the limits of a task."""
    return " ".join(map(str, [work.field_keys[name], *work.limits]))


def join_fields(work, arrays, facts, *, files, unbuilt):
    """Return a mesh's arrays and facts with further fields.

    Parameters
    ----------
    work : pandis.pipeline.dataset.rows.Work
    arrays : dict
    facts : pandis.pipeline.run.records.dataset.MeshFacts
    files : dict of str to bytes
    unbuilt : dict of str to dict
        Why other fields cannot be built: ``reason``; ``limits`` if other limits may help; ``again``
        if the next run may succeed.
    """
    names = {*files, *unbuilt}
    keys = {name: key for name, key in facts.field_keys.items() if name not in names}
    known = split_files(facts.files, arrays["files"])
    known = {name: file.tobytes() for name, file in known.items() if name not in names} | files
    why = {name: reason for name, reason in facts.unbuilt.items() if name not in names}
    for name in files:
        keys[name] = work.field_keys[name]
    for name, cause in unbuilt.items():
        why[name] = cause["reason"]
        if not cause.get("again"):  # without a key it is missing
            keys[name] = _limited_key(work, name) if "limits" in cause else work.field_keys[name]
    known, why, keys = (dict(sorted(part.items())) for part in (known, why, keys))
    data = np.frombuffer(b"".join(known.values()), np.uint8)
    sizes = {name: len(file) for name, file in known.items()}
    update = {"files": sizes, "unbuilt": why, "field_keys": keys}
    return arrays | {"files": data}, facts.model_copy(update=update)


def only_fields(work, facts):
    """Return facts without the fields that a task does not ask for.

    They say to try again if one that it asks for is missing.
    """
    parts = {
        part: {name: value for name, value in getattr(facts, part).items() if name in work.builds}
        for part in ("files", "unbuilt", "field_keys")
    }
    again = facts.again if facts.failed else bool(missing_fields(work, facts))
    return facts.model_copy(update=parts | {"again": again})


def stored_mesh(arrays, facts):
    """Return the artifact of kind ``mesh`` of a mesh whose rows are stored.

    It has no materials: fields of a mesh that has some are built from its source.
    """
    frame = Frame(facts.centre, facts.scale)
    solid = {name: arrays[name] for name in MESH}
    return Artifact("mesh", solid, frame.attributes() | {"shape": None})


def field_file(name, work, *, mesh, body):
    """Build a field of a mesh, as the stages `bake` and `export_native` do.

    Parameters
    ----------
    name : str
    work : pandis.pipeline.dataset.rows.Work
    mesh : pandis.pipeline.run.job.artifact.Artifact
        The repaired mesh.
    body : pandis.pipeline.geometry.body.Body

    Returns
    -------
    bytes
        The ``.pandis`` file, which was compared with the library's answers.

    Raises
    ------
    PandisError
        The field cannot be built of this mesh.
    """
    spec = known_field(name)
    provenance = {"mesh": work.member.name, "field": name, "key": work.field_keys[name]}
    artifact = _built(spec, mesh, work) if work.builds[name] else mesh
    options, field = NativeOptions(**work.export), open_field(spec, artifact)
    return export_native(field, body, options, provenance=provenance, log=_silent)


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

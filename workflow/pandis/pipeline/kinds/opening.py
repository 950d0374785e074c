"""Opens any field by name. Used only by evaluation, stress tests, timing, report and export.

A field with a file for ``pandis.h`` is queried through that file, so that measurements use what
programs load. The file is compared with the library's own answers when it is written.
"""

from pathlib import Path

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.kinds import kind_module
from pandis.pipeline.run.records.choice import ChoiceRecord


class Fields(list):
    """The fields of a body, in the order of the configuration; ``exact`` is always available."""

    def __init__(self, fields, body, exact):
        super().__init__(fields)
        self.body, self.exact = body, exact


def open_fields(names, mesh, files):
    """Open the fields of a mesh.

    Parameters
    ----------
    names : list of str
        As in the configuration.
    mesh : pandis.pipeline.run.job.artifact.Artifact
    files : iterable of pandis.pipeline.run.job.artifact.Artifact or Path
        ``{field}.pandis`` of each field, or the artifact of a field without such a file.

    Returns
    -------
    Fields
    """
    files = list(files)
    exported = {file.stem: file for file in files if isinstance(file, Path)}
    artifacts = [file for file in files if not isinstance(file, Path)]
    by_stem = {artifact.path.name.removesuffix(".zarr.zip"): artifact for artifact in artifacts}
    by_stem["mesh"] = mesh
    body = Body.open(mesh)

    def opened(name):
        if name in exported:
            return ExportedField(name, exported[name])
        spec = known_field(name)
        return open_field(spec, by_stem[spec.artifact])

    return Fields(map(opened, names), body, ExactField("exact", body))


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    if spec.kind == AUTO:
        chosen = ChoiceRecord.of(artifact).choice.field
        spec = known_field(chosen)._replace(name=spec.name)
    return kind_module(spec.kind, "reference").open_field(spec, artifact)

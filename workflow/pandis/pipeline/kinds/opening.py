"""Opens any field by its name, for evaluation, stress, timing, report and native export alone.

What has a file for ``pandis.h`` is answered by it: what a program loads is what is measured. The
library's own answers are what the file is compared with when it is written.

A new field is one module beside this one, its options in `pandis.pipeline.run.ask.options`, its
name in `pandis.pipeline.run.ask.catalogue`, and one line here.
"""

from pathlib import Path

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.exact.reference import ExactField
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.grid.implicit import AlgebraicField
from pandis.pipeline.kinds.grids import GRID_OPENERS
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.paper.planes import PlanesField
from pandis.pipeline.kinds.paper.proxy import ProxyField
from pandis.pipeline.run.ask.catalogue import ALGEBRAIC, AUTO, COMPACT, PLANE_FIELDS, parse_field
from pandis.pipeline.run.records.choice import ChoiceRecord


def _open_exact(name, mesh):
    return ExactField(name, Body.open(mesh))


_OPENERS = GRID_OPENERS | {"exact": _open_exact, "network": SirenField, ALGEBRAIC: AlgebraicField}
_OPENERS |= {COMPACT: CompactField}
_OPENERS |= dict.fromkeys(PLANE_FIELDS, PlanesField)


class Fields(list):
    """The fields of a body, in the order of the configuration; ``exact`` is always at hand."""

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
        What holds the fields: ``{field}.pandis``, or the artifact of a field that has none.

    Returns
    -------
    Fields
    """
    files = list(files)
    exported = {file.stem: file for file in files if isinstance(file, Path)}
    artifacts = [file for file in files if not isinstance(file, Path)]
    by_stem = {artifact.path.name.removesuffix(".zarr.zip"): artifact for artifact in artifacts}
    by_stem["mesh"] = mesh
    recipes = [stem.removeprefix("model-") for stem in by_stem if stem.startswith("model-")]
    body = Body.open(mesh)

    def opened(name):
        if name in exported:
            return ExportedField(name, exported[name])
        spec = parse_field(name, recipes)
        return open_field(spec, by_stem[spec.artifact])

    return Fields(map(opened, names), body, ExactField("exact", body))


def open_field(spec, artifact):
    """Return the field of a `FieldSpec`, from the artifact that holds it."""
    if spec.through:
        return ProxyField(spec.name, open_field(spec.through, artifact))
    return _OPENERS[kind_of(spec, artifact)](spec.name, artifact)


def kind_of(spec, artifact):
    """Return the kind of a field; of `auto`, that of the field it has come to."""
    if spec.kind != AUTO:
        return spec.kind
    chosen = ChoiceRecord.of(artifact).choice.field
    return parse_field(chosen, [chosen]).kind

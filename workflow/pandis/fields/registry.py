"""Opens any field by its name, for evaluation, stress, timing, report and native export alone.

A new field is one module beside this one, its options in `pandis.run.options`, its
name in `pandis.run.catalogue`, and one line here.
"""

from pandis.fields.exact import ExactField
from pandis.fields.grids import GRID_OPENERS
from pandis.fields.implicit import AlgebraicField
from pandis.fields.planes import PlanesField
from pandis.fields.proxy import ProxyField
from pandis.fields.siren import SirenField
from pandis.geometry.body import Body
from pandis.run.catalogue import ALGEBRAIC, AUTO, PLANE_FIELDS, parse_field


def _open_exact(name, mesh):
    return ExactField(name, Body.open(mesh))


_OPENERS = GRID_OPENERS | {"exact": _open_exact, "network": SirenField, ALGEBRAIC: AlgebraicField}
_OPENERS |= dict.fromkeys(PLANE_FIELDS, PlanesField)


class Fields(list):
    """The fields of a body, in the order of the configuration; ``exact`` is always at hand."""

    def __init__(self, fields, body, exact):
        super().__init__(fields)
        self.body, self.exact = body, exact


def open_fields(names, mesh, artifacts):
    """Open the fields of a mesh.

    Parameters
    ----------
    names : list of str
        As in the configuration.
    mesh : pandis.run.artifact.Artifact
    artifacts : iterable of pandis.run.artifact.Artifact
        What holds the other fields: grids and models.

    Returns
    -------
    Fields
    """
    held = {artifact.path.name.removesuffix(".zarr.zip"): artifact for artifact in artifacts}
    held["mesh"] = mesh
    recipes = [stem.removeprefix("model-") for stem in held if stem.startswith("model-")]
    body = Body.open(mesh)
    exact = ExactField("exact", body)
    specs = [parse_field(name, recipes) for name in names]
    opened = [exact if s.kind == "exact" else open_field(s, held[s.artifact]) for s in specs]
    return Fields(opened, body, exact)


def open_field(spec, artifact):
    """Return the field of a `pandis.run.catalogue.FieldSpec`, from the artifact that holds it."""
    if spec.through:
        return ProxyField(spec.name, open_field(spec.through, artifact))
    return _OPENERS[kind_of(spec, artifact)](spec.name, artifact)


def kind_of(spec, artifact):
    """Return the kind of a field; of `auto`, that of the field it has come to."""
    if spec.kind != AUTO:
        return spec.kind
    chosen = artifact.attributes["choice"]["field"]
    return parse_field(chosen, [chosen]).kind

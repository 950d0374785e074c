"""Opens any field by its name, for evaluation, stress, timing, report and native export alone.

A new field is one module beside this one, its options in `pandis.run.config`, its
name in `pandis.run.catalogue`, and one line here.
"""

from pandis.fields.exact import ExactField
from pandis.fields.grids import GRID_OPENERS
from pandis.fields.implicit import AlgebraicField
from pandis.fields.planes import PlanesField
from pandis.fields.proxy import ProxyField
from pandis.fields.siren import SirenField
from pandis.run.catalogue import ALGEBRAIC, AUTO, PLANE_FIELDS, parse_field

_OPENERS = GRID_OPENERS | {"exact": ExactField, "network": SirenField, ALGEBRAIC: AlgebraicField}
_OPENERS |= dict.fromkeys(PLANE_FIELDS, PlanesField)


class Fields(list):
    """The fields of a mesh, in the order of the configuration; ``exact`` is always at hand."""

    def __init__(self, fields, exact):
        super().__init__(fields)
        self.exact = exact


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
    exact = ExactField("exact", mesh)
    specs = [parse_field(name, recipes) for name in names]
    opened = [exact if s.kind == "exact" else open_field(s, held[s.artifact]) for s in specs]
    return Fields(opened, exact)


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

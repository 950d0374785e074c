"""Opens the grid fields by their names: what export and sizing import, without the networks."""

from pandis.catalogue import is_grid_field, parse_field
from pandis.fields.grid import GradientField, GridField, NearestField, TricubicField
from pandis.fields.spline import SplineField

GRID_OPENERS = {
    "nearest": NearestField,
    "trilinear": GridField,
    "trilinear-normal": GridField,
    "trilinear-gradient": GradientField,
    "tricubic": TricubicField,
    "spline": SplineField,
}


def open_grids(names, artifacts):
    """Open those of the named fields that are grids and held by one of the artifacts."""
    held = {artifact.path.name.removesuffix(".zarr.zip"): artifact for artifact in artifacts}
    grids = [parse_field(name, ()) for name in names if is_grid_field(name)]
    return [open_field(spec, held[spec.artifact]) for spec in grids if spec.artifact in held]


def open_field(spec, artifact):
    """Return the grid field of a `pandis.catalogue.FieldSpec`."""
    return GRID_OPENERS[spec.kind](spec.name, artifact)

"""Opens the grid fields by their names: what export and sizing import, without the networks."""

from pandis.pipeline.kinds.grid.implicit import CellField, ImplicitField, MarchedField
from pandis.pipeline.kinds.grid.reference import (
    GradientField,
    GridField,
    NearestField,
    TricubicField,
)
from pandis.pipeline.kinds.spline.reference import SplineField

GRID_OPENERS = {
    "nearest": NearestField,
    "trilinear": GridField,
    "nearest-box": NearestField,
    "trilinear-box": GridField,
    "trilinear-normal": GridField,
    "trilinear-gradient": GradientField,
    "tricubic": TricubicField,
    "kim": ImplicitField,
    "kim-ray": MarchedField,
    "kim-cell": CellField,
    "spline": SplineField,
}


def open_field(spec, artifact):
    """Return the grid field of a `pandis.pipeline.run.ask.catalogue.FieldSpec`."""
    return GRID_OPENERS[spec.kind](spec.name, artifact)

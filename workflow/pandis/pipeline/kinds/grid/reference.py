"""Opens grid fields; the form selects how a grid is interpolated."""

from pandis.pipeline.kinds.grid.implicit import CellField, ImplicitField, MarchedField
from pandis.pipeline.kinds.grid.interpolation import (
    GradientField,
    GridField,
    NearestField,
    TricubicField,
)

_FIELDS = {
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
}


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    return _FIELDS[spec.form](spec.name, artifact)

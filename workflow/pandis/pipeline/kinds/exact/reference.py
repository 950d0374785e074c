"""The exact field: the paper's ground truth (GT), through a tree instead of by brute force."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.field import ExactField


def open_field(spec, mesh):
    """Return the field of a `FieldSpec`, from its mesh."""
    return ExactField(spec.name, Body.open(mesh))

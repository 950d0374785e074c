"""Opens the fields of the methods with which the paper compares its own."""

from pandis.pipeline.kinds.paper.algebraic import AlgebraicField
from pandis.pipeline.kinds.paper.planes import PlanesField
from pandis.pipeline.kinds.paper.proxy import ProxyField
from pandis.pipeline.kinds.paper.spec import ALGEBRAIC
from pandis.pipeline.run.ask.kinds import kind_module


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    if spec.through:
        opened = kind_module(spec.through.kind, "reference").open_field(spec.through, artifact)
        return ProxyField(spec.name, opened)
    return (AlgebraicField if spec.form == ALGEBRAIC else PlanesField)(spec.name, artifact)

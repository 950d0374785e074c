"""Types of option values, and the base of all models of options."""

import re
from math import inf
from numbers import Real
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from pandis.pipeline.run.ask.budget import AMOUNT, amount

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
Angle = Annotated[float, Field(ge=-360, le=360)]


def _amount(value):
    """Check an amount of force, and return it as the user wrote it."""
    amount(value)
    return value


#: Metres in each unit of length.
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}


def _metres(value):
    """Return a length in metres; a text may end with a unit."""
    match = re.fullmatch(r"([\d.eE+-]+) *(mm|cm|m|in)", value) if isinstance(value, str) else None
    if not match:
        return value
    try:
        return round(float(match[1]) * UNITS[match[2]], 12)
    except ValueError:
        return value


#: Fewest and most cells of a solid along its longest side.
CELLS = (64, 1024)
_FINENESS = r"((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) ?([A-Za-zµ%]*)"


def fineness(text):
    """Return the number and the unit of `mesh.solid_error`, as in ``0.2 mm``.

    Raises
    ------
    ValueError
        It is neither a possible number of cells nor an error.
    """
    match = re.fullmatch(_FINENESS, text)
    if not match or match[2] not in ("", "%", "cells", *UNITS) or not 0 < float(match[1]) < inf:
        raise ValueError(
            "write cells, as 256 cells, or an error: 0.1 % (of the diagonal), 0.2 (mesh units) or "
            f"0.2 mm (units are {', '.join(UNITS)})"
        )
    number, unit = float(match[1]), match[2]
    if unit == "cells" and not CELLS[0] <= number <= CELLS[1]:
        raise ValueError(f"{CELLS[0]} to {CELLS[1]} cells are possible")
    return number, unit


def _fineness(value):
    """Check a fineness, and return it as text."""
    if isinstance(value, Real) and not isinstance(value, bool):
        value = str(value) if isinstance(value, int) else repr(float(value))
    if isinstance(value, str):
        fineness(value)
    return value


_LENGTHS = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string", "pattern": r"^[\d.eE+-]+ *(mm|cm|m|in)$"},
    ]
}
Length = Annotated[Positive, BeforeValidator(_metres), WithJsonSchema(_LENGTHS)]
_AMOUNTS = {
    "anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string", "pattern": f"^{AMOUNT}$"},
    ]
}
Fineness = Annotated[
    str,
    BeforeValidator(_fineness),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}]}),
]
Force = Annotated[float | str, BeforeValidator(_amount), WithJsonSchema(_AMOUNTS)]
Missed = Annotated[float, Field(gt=0, le=0.005)]
Place = Annotated[float, Field(ge=-100, le=100)]


class Options(BaseModel):
    """Base of all options: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", validate_default=False)

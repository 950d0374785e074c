"""Types of option values, and the base of all models of options."""

import re
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
Force = Annotated[float | str, BeforeValidator(_amount), WithJsonSchema(_AMOUNTS)]
Missed = Annotated[float, Field(gt=0, le=0.005)]
Place = Annotated[float, Field(ge=-100, le=100)]


class Options(BaseModel):
    """Base of all options: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", validate_default=False)

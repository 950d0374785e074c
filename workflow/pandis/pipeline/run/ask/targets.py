"""Requirements on fields, and the physical scale that they refer to."""

from pydantic import Field, field_validator, model_validator

from pandis.pipeline.run.ask.values import Count, Force, Length, Missed, Options, Positive

#: Largest size of an object in a device's workspace, m.
LARGEST_DEVICE = 10.0


class DeviceOptions(Options):
    """Physical scale: size and stiffness of the object in the device's workspace."""

    size: Length = Field(
        0.10,
        description="length of the mesh's longest side in the workspace, m, or with its unit: "
        "`60 mm`, `6 cm`",
    )
    stiffness: Positive = Field(400.0, description="stiffness k of the surface, N/m")

    @field_validator("size")
    @classmethod
    def _fits_a_workspace(cls, value):
        if value > LARGEST_DEVICE:
            raise ValueError(
                f"no device reaches that far: at most {LARGEST_DEVICE:g}, in metres (for a part of "
                "60 mm, write 0.06)"
            )
        return value


class GridTarget(Options):
    """Requirements on a field named `…-auto`."""

    force_error: Force | None = Field(
        None, description="mean force error on the contact set: written as in `budget`"
    )
    tail: Force | None = Field(
        None, description="with `force_error`: its 99th percentile; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="with `force_error`: share of the surface that may lack the force"
    )
    bytes: Count | None = Field(None, description="memory that the field may need, in bytes")

    @model_validator(mode="after")
    def _one_target(self):
        if (self.force_error is None) == (self.bytes is None):
            raise ValueError("name one of force_error and bytes, but not both")
        return self


class BudgetOptions(Options):
    """Requirements on the field `auto`: it is the cheapest field to build that meets all of them.

    Errors are those of the contact set: points down to 0.04 below the surface, or to nine tenths of
    the radius of the largest ball inside that touches it there.
    """

    force_error: Force | None = Field(
        None,
        description="mean force error: a number (unit frame, k = 1), or a text such as `20 mN` (at "
        "`device`) or `5 %` (of the mean force)",
    )
    tail: Force | None = Field(
        None, description="99th percentile of the error, in the same form; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="share of the surface that may lack the force: 0.005 at most"
    )
    query_time: Positive | None = Field(
        None,
        description="largest median time of one query, in seconds, as listed in "
        "`config/query-times.csv` (`snakemake -j1 -f calibrate` measures that table on your "
        "machine)",
    )
    bytes: Count | None = Field(None, description="memory that the field may need, in bytes")

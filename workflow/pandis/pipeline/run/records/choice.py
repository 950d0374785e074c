"""The attributes of ``choice.zarr.zip``, besides those of the field that was chosen."""

from pandis.pipeline.run.records.record import Record


class Chosen(Record):
    """The field that was chosen.

    Attributes
    ----------
    field : str
    bytes : int
    held_out_error : float
    held_out : dict of str to float
        ``mean``, ``p99``, ``missing`` and ``left_out`` on the points that promises rest on.
    fits : float or None
        By how many times it exceeds the limits: 1 or less. The exact field is not measured.
    query_time : float or None
        s; where the budget names one.
    """

    field: str
    bytes: int
    held_out_error: float
    held_out: dict[str, float]
    fits: float | None = None
    query_time: float | None = None


class ScaleRecord(Record):
    """What an error is told by: newtons per force of the unit frame, and the mean force there."""

    newtons: float
    mean_force: float


class Passed(Record):
    """A field that was not taken, and why."""

    field: str
    why: str


class ChoiceRecord(Record):
    """What `fields: auto` has come to, what was asked for, and what was not taken."""

    choice: Chosen
    asked: dict
    limits: dict[str, float]
    considered: list[Passed]
    scale: ScaleRecord

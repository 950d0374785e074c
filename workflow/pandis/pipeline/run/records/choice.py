"""The attributes of ``choice.zarr.zip``, except those of the chosen field."""

from pandis.pipeline.run.records.record import Record


class Chosen(Record):
    """The chosen field.

    Attributes
    ----------
    field : str
    bytes : int
    held_out_error : float
    held_out : dict of str to float
        ``mean``, ``p99``, ``missing`` and ``left_out`` on points that were not used to choose it.
    fits : float or None
        Largest ratio of an error to its limit, at most 1; None for the exact field (not measured).
    query_time : float or None
        s; None if the budget sets no query time.
    """

    field: str
    bytes: int
    held_out_error: float
    held_out: dict[str, float]
    fits: float | None = None
    query_time: float | None = None


class ScaleRecord(Record):
    """Scale of errors: newtons per unit of force in the unit frame, and the mean force there."""

    newtons: float
    mean_force: float


class Passed(Record):
    """A field that was considered but not chosen, and why."""

    field: str
    why: str


class ChoiceRecord(Record):
    """Result of `fields: auto`: the chosen field, the budget, and the fields not chosen."""

    choice: Chosen
    asked: dict
    limits: dict[str, float]
    considered: list[Passed]
    scale: ScaleRecord

"""The attributes of ``evaluation.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Figures(Record):
    """Errors of a field's force on a set of points (unit frame, k = 1).

    Attributes
    ----------
    mean, p99, max : float
    rms, p95, eq7, angle : float or None
        None on the contact sets: see `pandis.pipeline.judge.errors.errors.statistics`.
    relative, newtons, missing, felt, judged : float or None
        On the trajectory and the contact sets only: the mean error, as a share of the mean force
        and in newtons; and shares of area (see `pandis.pipeline.geometry.shares.shares`).
    strongly_felt : float or None
        On the contact sets only: see `pandis.pipeline.geometry.shares.differences`.
    """

    mean: float
    p99: float
    max: float
    rms: float | None = None
    p95: float | None = None
    eq7: float | None = None
    angle: float | None = None
    relative: float | None = None
    newtons: float | None = None
    missing: float | None = None
    felt: float | None = None
    judged: float | None = None
    strongly_felt: float | None = None


class PathsRecord(Record):
    """Errors of a field on several paths: see `pandis.pipeline.judge.errors.paths.over_paths`."""

    mean: float
    interval: float
    ratios: dict[str, float]


class EvaluationRecord(Record):
    """Errors of all fields against the exact one.

    Attributes
    ----------
    fields : list of str
    errors : dict of str to dict of str to Figures
        By set and field.
    controls : dict of str to dict of str to Figures
        By control and contact set.
    contact : dict
        ``left_out``: share of the area that is too thin to be judged.
    mean_force : dict of str to float
        Mean magnitude of exact forces, by set.
    bytes : dict of str to int
        By field.
    force_unit : str
    coverage : dict
        From `pandis.pipeline.judge.errors.coverage.coverage`.
    paths : dict of str to PathsRecord
        By field; empty if there is only one path.
    size, stiffness, newtons : float
        The device's scale: m, N/m, and newtons per unit of force in the unit frame.
    count : int
        Number of trajectories.
    """

    fields: list[str]
    errors: dict[str, dict[str, Figures]]
    controls: dict[str, dict[str, Figures]]
    contact: dict
    mean_force: dict[str, float]
    bytes: dict[str, int]
    force_unit: str
    coverage: dict
    paths: dict[str, PathsRecord]
    size: float
    stiffness: float
    newtons: float
    count: int

    def attributes(self):
        """Return the record as plain attributes, without figures that are None."""
        return self.model_dump(exclude_none=True)

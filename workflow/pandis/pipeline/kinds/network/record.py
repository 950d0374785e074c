"""The attributes of ``model-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Architecture(Record):
    """A network: its sine layers, their units and ω0, and 4 outputs or 1 (Φ alone)."""

    width: int
    depth: int
    omega: float
    outputs: int

    @classmethod
    def of(cls, artifact):
        """Return the architecture of a network's artifact."""
        return cls.checked(artifact, artifact.attributes["architecture"])


class Spread(Record):
    """A mean with its spread."""

    mean: float
    std: float


class Error(Record):
    """A force error, unit frame, k = 1."""

    mean: float
    p99: float


class ModelRecord(Record):
    """How a network was trained.

    Attributes
    ----------
    architecture : Architecture
    recipe : str
        Its loss.
    options : dict
        Options of the recipe, except the accuracy asked for.
    steps, restarts : int
    reproducible : bool
    device : str
    curve_columns : list of str
    held_out_error : Error
        On points that it was not trained on.
    direction_length : Spread
        Length of the direction before normalisation, on those points.
    """

    architecture: Architecture
    recipe: str
    options: dict
    steps: int
    restarts: int
    reproducible: bool
    device: str
    curve_columns: list[str]
    held_out_error: Error
    direction_length: Spread

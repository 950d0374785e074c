"""The attributes of ``model-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Architecture(Record):
    """A network: units per sine layer, number of sine layers, ω0, and 4 outputs or 1 (Φ alone)."""

    width: int
    depth: int
    omega: float
    outputs: int

    @classmethod
    def of(cls, artifact):
        """Return the architecture of a network's artifact."""
        return cls.checked(artifact, artifact.attributes["architecture"])


class Spread(Record):
    """A mean with its standard deviation."""

    mean: float
    std: float


class Error(Record):
    """Mean and 99th percentile of the force error (unit frame, k = 1)."""

    mean: float
    p99: float


class ModelRecord(Record):
    """A network and its training.

    Attributes
    ----------
    architecture : Architecture
    recipe : str
        Loss of the recipe.
    options : dict
        Options of the recipe, except the requested accuracy.
    steps, restarts : int
    reproducible : bool
    device : str
    curve_columns : list of str
    held_out_error : Error
        Force error at points that were not used for training.
    direction_length : Spread
        Length of the direction before normalisation, at the same points.
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

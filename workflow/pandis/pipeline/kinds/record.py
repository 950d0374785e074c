"""Describes the nodes of a grid: the attribute ``grid`` of its artifact."""

from pandis.pipeline.run.records.record import Record


class BandRecord(Record):
    """How far a grid is valid: below the surface and above it (unit frame)."""

    inside: float
    outside: float


class GridRecord(Record):
    """The grid of an artifact."""

    content: str
    size: int
    band: BandRecord

    @classmethod
    def of(cls, artifact):
        """Return the record of a grid's artifact."""
        return cls.checked(artifact, artifact.attributes["grid"])

    def attributes(self):
        """Return the record as it stands among the attributes."""
        return {"grid": self.model_dump()}


class DenseRecord(GridRecord):
    """A dense grid: its first node, its last, and the node spacing (unit frame)."""

    axes: tuple[str, str, str] = ("x", "y", "z")
    centering: str = "node"
    origin: tuple[float, float, float]
    corner: tuple[float, float, float]
    spacing: list[float]
    unit: str = "unit frame"
    exact_nodes: int
    beyond_the_band: dict[str, str]


class SplineRecord(GridRecord):
    """The three lattices of a spline: nodes per axis, the low end of the far one, and the offset
    and scale of each one's integers.
    """

    base_size: int
    far_size: int
    far_low: float
    scales: dict[str, tuple[float, float]]
    unit: str = "unit frame"

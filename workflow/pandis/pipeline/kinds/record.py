"""Describes the nodes of a grid: the attribute ``grid`` of its artifact."""

from pandis.pipeline.run.records.record import Record


class BandRecord(Record):
    """Depth below the surface and height above it to which a grid is valid (unit frame)."""

    inside: float
    outside: float


class GridRecord(Record):
    """Content, nodes per axis and band of the grid in an artifact."""

    content: str
    size: int
    band: BandRecord

    @classmethod
    def of(cls, artifact):
        """Return the record of a grid's artifact."""
        return cls.checked(artifact, artifact.attributes["grid"])

    def attributes(self):
        """Return the record as an attribute of the artifact."""
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
    """The three lattices of a spline.

    The record holds the nodes per axis, the lower bound of the far lattice, and the offset and
    scale of each lattice's integers.
    """

    base_size: int
    far_size: int
    far_low: float
    scales: dict[str, tuple[float, float]]
    unit: str = "unit frame"

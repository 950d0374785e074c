"""The attributes of ``compact-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class CompactRecord(Record):
    """A compact mesh: bits per coordinate; numbers of its faces, of the original mesh's faces and
    of its vertices; largest distance between the two surfaces, and largest excess of a distance
    due to rounding; number of faces with reversed orientation; maximum number of face groups and
    blocks that a query visits; largest magnitude of a coordinate, and box (unit frame).
    """

    bits: int
    faces: int
    faces_before: int
    vertices: int
    deviation: float
    rounding: float
    turned: int
    most: int
    reach: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    unit: str = "unit frame"

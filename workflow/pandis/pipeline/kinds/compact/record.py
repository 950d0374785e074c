"""The attributes of ``compact-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class CompactRecord(Record):
    """A compact mesh: bits per coordinate; numbers of its faces, of the original mesh's faces and
    of its vertices; bound on the distance between the two surfaces; bound on the amount by which
    rounding makes a distance too large; number of faces with reversed orientation; maximum number
    of face groups and blocks that a query visits; largest magnitude of a coordinate; lowest and
    highest corner of the box (unit frame).
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

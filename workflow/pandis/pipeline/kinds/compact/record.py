"""The attributes of ``compact-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class CompactRecord(Record):
    """A compact mesh: bits per coordinate; numbers of its faces, of the mesh's faces and of its
    vertices; the largest distance between the two surfaces, and by how much rounding can make a
    distance too large; number of faces whose orientation is reversed; most groups of faces and
    blocks that a query visits; its largest coordinate, and its box (unit frame).
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

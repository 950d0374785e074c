"""The attributes of ``compact-….zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class CompactRecord(Record):
    """A compact mesh: bits of a coordinate; how many faces and vertices it has, and how many faces
    the mesh had; how far the two surfaces lie apart at most, and by how much rounding can make a
    distance too large; faces that look to the other side than before; groups of faces, and blocks,
    that a query looks at; its largest coordinate, and its box (unit frame).
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

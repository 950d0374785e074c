"""The attributes of ``mesh.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Rung(Record):
    """A repair attempt: the operation, and whether its result was kept."""

    rung: str
    operation: str
    kept: bool
    reason: str | None


class Component(Record):
    """A component of a solid: its kind, faces before simplification, and volume.

    The kind is ``closed`` (the source's surface alone), ``filled`` (caps or doors close it),
    ``solid`` (walls of the source lie inside) or ``sheet`` (a thickness was given to it).
    """

    kind: str
    faces: int
    volume: float


class SolidFacts(Record):
    """What was invented to make a solid. Lengths and volumes are in mesh units.

    Attributes
    ----------
    why : str
        Why no exact repair was enough.
    cells : int
        Cells along the longest side.
    cell : float
        Their size.
    rooms, opened, cavities : int
        Closed rooms; of these, air because too much of their walls would be invented; and hollow.
    caps, doors : list of float
        Widths of the holes and of the gaps closed, widest first.
    invented, sheets : float
        Shares of the area that caps and doors, and sheets with a thickness, have.
    thickness : float
        Thickness of sheets.
    kinds : dict of str to int
        Number of components of each kind.
    components, dropped : list of Component
        The largest of each, and those left out as debris.
    simplified : float
        Tolerance of the simplification, cells.
    """

    why: str = ""
    cells: int
    cell: float
    rooms: int
    opened: int
    cavities: int
    caps: list[float]
    doors: list[float]
    invented: float
    sheets: float
    thickness: float
    kinds: dict[str, int]
    components: list[Component]
    dropped: list[Component]
    simplified: float


class MeshRecord(Record):
    """A repaired mesh.

    Attributes
    ----------
    source : dict
        Name, reader, format and unit of the source.
    shape : str or None
        Closed form, if the mesh is a tessellation of one.
    before, after : dict
        See `pandis.pipeline.mesh.diagnosis.Diagnosis.attributes`.
    faults_before : str
    rungs : list of Rung
    deviation : dict
        How far the repair moved the surface.
    solid : SolidFacts or None
        What was invented, if the mesh is a solid of its source.
    """

    source: dict
    shape: str | None
    before: dict
    after: dict
    faults_before: str
    rungs: list[Rung]
    deviation: dict
    solid: SolidFacts | None

    @property
    def caps(self):
        """Share of points of the surface on caps, doors and walls of a sheet."""
        return self.deviation["to_source"]["caps"]

    @property
    def moved(self):
        """Largest distance between source and result, caps apart, mesh units."""
        return max(self.deviation[way]["max"] for way in ("to_source", "to_result"))

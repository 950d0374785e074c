"""The attributes of ``mesh.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Rung(Record):
    """A repair attempt: the operation, and whether its result was kept."""

    rung: str
    operation: str
    kept: bool
    reason: str | None


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
    """

    source: dict
    shape: str | None
    before: dict
    after: dict
    faults_before: str
    rungs: list[Rung]
    deviation: dict

    @property
    def moved(self):
        """Largest distance of the result from the source, caps of holes apart, mesh units."""
        return self.deviation["to_source"]["max"]

"""The attributes of ``mesh.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class Rung(Record):
    """An attempt of the repair: what was done, and whether it was kept."""

    rung: str
    operation: str
    kept: bool
    reason: str | None


class MeshRecord(Record):
    """A repaired mesh.

    Attributes
    ----------
    source : dict
        Name, reader, format and unit of what was read.
    shape : str or None
        The closed form, of which the mesh is a tessellation.
    before, after : dict
        See `pandis.pipeline.mesh.diagnosis.Diagnosis.attributes`.
    faults_before : str
    rungs : list of Rung
    deviation : dict
        How far the repair has moved the surface.
    """

    source: dict
    shape: str | None
    before: dict
    after: dict
    faults_before: str
    rungs: list[Rung]
    deviation: dict

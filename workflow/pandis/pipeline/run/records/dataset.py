"""The attributes of a data set's shards and of its index."""

from typing import Any

from pydantic import Field

from pandis.pipeline.run.records.record import Record


class Failure(Record):
    """Why a mesh came to nothing: the stage, the reason, and options that would help."""

    stage: str
    reason: str
    option: dict[str, Any] = Field(default_factory=dict)


class MeshFacts(Record):
    """What is known of a mesh of a data set. Lengths are in mesh units.

    Attributes
    ----------
    name, source, inside, licence, tags : str
        As planned: see `pandis.pipeline.run.ask.members.Member`.
    key : str
        Digest of everything that the rows depend on.
    failed : Failure or None
    again : bool
        Whether the next run is to try again, a field if there are rows: the cause lay outside of
        the mesh.
    limits : list of float or None
        Seconds and memory (GiB) with which the mesh failed, if others may help.
    shard : list of int
        Number of the shard, and place of the mesh in it; only in the index.
    rows, vertices, faces : int
    files : dict of str to int
        Sizes of the files of its fields, bytes, sorted by name.
    unbuilt : dict of str to str
        Why there is no file of other fields.
    field_keys : dict of str to str
        For each of both, the digest of everything that the file depends on.
    materials : int
        Number of materials of its faces, which the files know.
    unit, format : str
    notes : list of str
        Remarks of the reader.
    faults : dict of str to int
        Faults of the mesh as it was read.
    repair : list of str
        Operations that repaired it.
    kinds : dict of str to int
        Components of each kind, if it was made solid: see
        `pandis.pipeline.run.records.mesh.Component`.
    invented, sheets : float
        Shares of the area that caps and doors, and sheets with a thickness, have. Of a mesh that
        was repaired exactly, the share of points on caps.
    openings : int
        Caps and doors.
    moved_percent : float
        Largest distance between the surface as read and the result, caps apart, % of the diagonal.
    faces_read, components : int
    genus : int or None
    volume, area : float
    centre, scale
        The unit frame: ``(x - centre) * scale``.
    """

    name: str = ""
    source: str = ""
    inside: str = ""
    licence: str = ""
    tags: str = ""
    key: str = ""
    failed: Failure | None = None
    again: bool = False
    limits: list[float] | None = None
    shard: list[int] = Field(default_factory=list)
    rows: int = 0
    vertices: int = 0
    faces: int = 0
    files: dict[str, int] = Field(default_factory=dict)
    unbuilt: dict[str, str] = Field(default_factory=dict)
    field_keys: dict[str, str] = Field(default_factory=dict)
    materials: int = 0
    unit: str = "unknown"
    format: str = ""
    notes: list[str] = Field(default_factory=list)
    faults: dict[str, int] = Field(default_factory=dict)
    repair: list[str] = Field(default_factory=list)
    kinds: dict[str, int] = Field(default_factory=dict)
    invented: float = 0.0
    sheets: float = 0.0
    openings: int = 0
    moved_percent: float = 0.0
    faces_read: int = 0
    components: int = 0
    genus: int | None = None
    volume: float = 0.0
    area: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0

    @property
    def way(self):
        """How the mesh became a solid: ``valid as read``, ``repaired exactly``, ``solid``."""
        if self.kinds:
            return "solid"
        return "repaired exactly" if self.repair else "valid as read"


class ShardRecord(Record):
    """A shard: its meshes, in the order of their rows, and the rows that are stored together."""

    meshes: list[MeshFacts]
    chunk: int


class Cause(Record):
    """Failures with one reason: their count, a mesh, and the option that would help."""

    stage: str
    reason: str
    count: int
    example: str
    option: dict[str, Any]


class Summary(Record):
    """What a data set amounts to.

    Attributes
    ----------
    meshes, ready, failed, rows : int
    ways, faults, components, licences : dict of str to int
        Meshes by how they became solids, by their faults before, and by licence; components of
        solids by kind.
    moved_percent : dict of str to float
        Percentiles over the meshes.
    causes : list of Cause
        Why meshes failed, and why fields of others could not be built.
    """

    meshes: int
    ready: int
    failed: int
    rows: int
    ways: dict[str, int]
    faults: dict[str, int]
    components: dict[str, int]
    licences: dict[str, int]
    moved_percent: dict[str, float]
    causes: list[Cause]


class DatasetRecord(Record):
    """The index of a data set; ``shards`` has the digest of each."""

    dataset: str
    source: str
    shards: list[str]
    meshes: list[MeshFacts]
    summary: Summary
    strata: list[str]
    chunk: int
    sign: str = "negative inside"
    frame: str = "points are (x - centre) * scale of each mesh; distances are multiplied by scale"

"""The attributes of a scene's artifact, and the contents of its JSON file."""

from pandis.pipeline.run.ask.contacts import TextureOptions
from pandis.pipeline.run.ask.tasks import PlacedObject
from pandis.pipeline.run.records.record import Record


class PlacedRecord(PlacedObject):
    """An object of a scene, with its file and the map from mesh units to metres.

    ``materials`` and ``textures``: feel of its surface, or of each of its regions, by name.
    ``beside_file``: a mesh's file, which contains the regions if the field's file does not.
    """

    file: str
    beside_file: str | None
    rotation_matrix: list[list[float]]
    translation: list[float]
    scale: float
    materials: dict[str, dict]
    textures: dict[str, TextureOptions | None]


class TouchedRecord(Record):
    """The walk of a `SceneRecord`, repeated with a proxy for every object.

    Attributes
    ----------
    radius : float
        Radius of the probe, m.
    queries_mean, queries_max : float, int
        Queries per tick (mean, maximum).
    touched_share : float
        Share of the ticks in contact.
    different : int
        Number of forces that differ from those found by stepping every object.
    median_us, p999_us : float
        Median and 99.9th percentile of a tick, µs.
    """

    radius: float
    queries_mean: float
    queries_max: int
    touched_share: float
    different: int
    median_us: float
    p999_us: float


class SceneRecord(Record):
    """A walk through a scene.

    Attributes
    ----------
    objects : list of PlacedRecord
    ticks : int
    speed : float
        m/s.
    asked_mean, asked_max : float, int
        Fields queried per tick (mean, maximum).
    touched_share : float
        Share of the ticks in contact.
    different : int
        Number of forces that differ from those found by querying every object.
    median_us, p999_us : float
        Median and 99.9th percentile of a tick, µs.
    proxies : TouchedRecord or None
        None if an object has no proxy: ``no_proxies`` says which.
    machine : dict
    sentence : str
    """

    objects: list[PlacedRecord]
    ticks: int
    speed: float
    asked_mean: float
    asked_max: int
    touched_share: float
    different: int
    median_us: float
    p999_us: float
    proxies: TouchedRecord | None
    no_proxies: str
    machine: dict
    sentence: str = ""
    reproducible: bool = False

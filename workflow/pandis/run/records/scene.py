"""The attributes of a scene's artifact, and its JSON file."""

from pandis.run.records.record import Record
from pandis.run.tasks import PlacedObject


class PlacedRecord(PlacedObject):
    """An object of a scene with its file and the map from its mesh's units to metres."""

    file: str
    rotation_matrix: list[list[float]]
    translation: list[float]
    scale: float


class SceneRecord(Record):
    """A walk through a scene.

    Attributes
    ----------
    objects : list of PlacedRecord
    ticks : int
    speed : float
        m/s.
    asked_mean, asked_max : float, int
        Fields asked per tick.
    touched_share : float
        Share of the ticks in contact.
    different : int
        Forces that are not those of asking every object.
    median_us, p999_us : float
        Of a tick.
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
    machine: dict
    sentence: str = ""
    reproducible: bool = False

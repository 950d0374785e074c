"""Contents of the page for one mesh."""

from dataclasses import dataclass

from pandis.base.frame import Frame
from pandis.pipeline.kinds.network.record import ModelRecord
from pandis.pipeline.report.picture import Picture
from pandis.pipeline.run.records.evaluation import EvaluationRecord
from pandis.pipeline.run.records.hardware import HardwareRecord
from pandis.pipeline.run.records.mesh import MeshRecord
from pandis.pipeline.run.records.stress import StressRecord
from pandis.pipeline.run.records.timing import TimingRecord


@dataclass(frozen=True)
class Section:
    """One mesh of the page, with its pictures.

    Attributes
    ----------
    name : str
    rows, controls : list of dict
        Rows of the summary, for fields and for controls.
    picks, advice : list of dict
        The files to use: see `pandis.pipeline.report.picks` and
        `pandis.pipeline.judge.errors.front.recommend`.
    columns : dict of str to str
        Titles of the columns that are not empty.
    built, sound : int
        Numbers of fields that were built, and of fields that may be used.
    per_unit, metres : float
        Newtons per mesh unit of depth, and metres per mesh unit at the device's scale.
    judged, walls : float, int
        Share of the surface that is judged, and number of points that the validation compares.
    builds : dict of str to float
        Seconds by field.
    versions : dict of str to str
    sentence, paths_said : str
    repair : list of str
    verdicts, proxy_verdicts, notes : dict of str to str
        Texts by field: failures without a proxy, failures through one, how a network was trained.
    followed : str
        Why the path is less deep than configured; empty if it is not.
    touch : str or None
        HTML of the interactive part in which the mesh's fields are touched.
    choice : dict or None
        Result of `fields: auto`, in words.
    """

    name: str
    mesh: MeshRecord
    evaluation: EvaluationRecord
    stress: StressRecord
    timing: TimingRecord
    hardware: HardwareRecord
    models: dict[str, ModelRecord]
    frame: Frame
    rows: list
    controls: list
    picks: list
    advice: list
    columns: dict
    built: int
    sound: int
    per_unit: float
    metres: float
    judged: float
    walls: int
    builds: dict
    versions: dict
    sentence: str
    paths_said: str
    repair: list
    verdicts: dict
    proxy_verdicts: dict
    notes: dict
    followed: str
    choice: dict | None
    view: str
    touch: str | None
    picture: Picture
    heat: Picture | None
    sections: Picture | None
    holding: Picture
    quiver: Picture
    path: Picture
    front: Picture
    samples: Picture | None
    curves: Picture | None
    histogram: Picture | None

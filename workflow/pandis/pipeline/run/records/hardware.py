"""What the validation says of every field: the attributes of ``hardware.zarr.zip``."""

from pandis.pipeline.run.ask.contacts import TextureOptions
from pandis.pipeline.run.records.record import Record


class WallVerdict(Record):
    """How a field's forces compare with the exact ones, below surface points of every thickness.

    Attributes
    ----------
    missing, felt, judged : float
        Shares of area: see `pandis.pipeline.geometry.shares.shares`.
    left_out : float
        Share of the area whose walls are too thin to be judged.
    strongly_felt, patch, p99_n : float
        Shares of area, and newtons: see `pandis.pipeline.geometry.shares.differences`.
    points : int
        How many were compared.
    pressed_missing : int
        At how many of the points that a device presses on the force is missing.
    ghost_n : float
        The largest force in free space away from the surface.
    holds : bool
        It is missing at none of these, and all figures are within their limits.
    """

    missing: float
    felt: float
    judged: float
    left_out: float
    strongly_felt: float
    patch: float
    p99_n: float
    points: int
    pressed_missing: int
    ghost_n: float
    holds: bool


class Pressed(Record):
    """A simulated device with a field, pressed onto a mesh.

    Attributes
    ----------
    hand : float
        Ns/m: the damping of the hand that all of this is about.
    hands : dict of str to float
        N/m: the largest safe stiffness for it and for others, by their damping.
    released_n_m : float
        The same with a weight in place of a hand.
    stiffness : float
        N/m.
    strongest_n, steepest_n_per_ms : float
        The largest force, and its largest change.
    cut : int
        Ticks at the force limit.
    energy_j : float
        The least balance of the wall and the device, see ``energy.h``.
    quiet : float
        Share of the presses that reach a wall and do not shake there, of those that friction lets
        reach one.
    unarmed : int
        Presses that were skipped: the field pushed at every height at which one could begin.
    reach_m : float
        How far from the workspace's middle the probe came.
    ended : str
        Why, if a run ended early.
    within_limits, passive : bool
    safe_n_m : float
        The largest safe stiffness for the hand, and in ``limited_by`` what keeps it from more.
    """

    hand: float
    hands: dict[str, float]
    released_n_m: float
    stiffness: float
    strongest_n: float
    steepest_n_per_ms: float
    cut: int
    energy_j: float
    quiet: float
    unarmed: int
    reach_m: float
    ended: str
    within_limits: bool
    passive: bool
    safe_n_m: float
    limited_by: str


class DeviceVerdict(Pressed):
    """What a simulated device makes of a field, with what it lacks, and a sentence."""

    device: str
    pressed_missing: int
    holds: bool
    verdict: str
    sentence: str


class TouchVerdict(Pressed):
    """What a simulated device makes of a field through a proxy.

    Attributes
    ----------
    device : str
    presses : int
        Of 1.2 times the device's largest force, on thin and thick places.
    passes, penalty_passes : int
        In how many of them the proxy, and the probe under penalty forces, came through a wall.
    deepest_m : float
        How deep a proxy lay below the mesh.
    holds : bool
        As of `WallVerdict`.
    verdict, sentence : str
    """

    device: str
    presses: int
    passes: int
    penalty_passes: int
    deepest_m: float
    holds: bool
    verdict: str = ""
    sentence: str = ""


class ProxyVerdict(Record):
    """What is said of a field through a proxy.

    Attributes
    ----------
    radius : float
        Radius of the probe, m.
    materials : dict of str to dict
        What surfaces feel like, by the names of their materials.
    textures : dict of str to (pandis.pipeline.run.ask.contacts.TextureOptions or None)
        By the same names; empty without any.
    budget : int
        Queries that a tick may take.
    queries, compute_us : dict of str to float
        Per tick, along the trajectory: percentiles.
    miss_share : float
        Share of ticks that computed too long; ``in_time``: few enough, of some that touched.
    touching_share, behind_share : float
        Shares of ticks that touched, and of those whose budget did not suffice.
    devices : dict of str to TouchVerdict
    """

    radius: float
    materials: dict[str, dict]
    textures: dict[str, TextureOptions | None]
    budget: int
    queries: dict[str, float]
    compute_us: dict[str, float]
    miss_share: float
    in_time: bool
    touching_share: float
    behind_share: float
    devices: dict[str, TouchVerdict]


class Ticks(Record):
    """Times of the ticks of a run: percentiles in µs, and shares beyond the deadline."""

    ticks: int
    compute_us: dict[str, float]
    lateness_us: dict[str, float]
    late_share: float
    miss_share: float


class ServoVerdict(Ticks):
    """What the servo loop says of a field on this machine.

    Attributes
    ----------
    misses, longest_run_of_misses : int
    agreement : float
        Largest difference from the forces that were evaluated (unit frame, k = 1).
    agrees, in_time, punctual : bool
        It is small enough; few enough ticks compute too long; few enough begin too late.
    walls : WallVerdict
    verdict, sentence : str
    loaded : Ticks or None
        The same beside other work on every core.
    """

    misses: int
    longest_run_of_misses: int
    agreement: float
    agrees: bool
    in_time: bool
    punctual: bool
    walls: WallVerdict
    verdict: str = ""
    sentence: str = ""
    loaded: Ticks | None = None


class AttachedRun(Record):
    """A run on the attached device: what it was that ran, how it ended, and its figures.

    ``contact`` is what the forces were: ``proxy`` or ``penalty``.
    """

    statement: str
    hardware: bool
    stand_in: bool
    armed: bool
    refused: str
    armed_at: int
    model: str
    contact: str
    ended: str
    code: int
    ticks: int
    stiffness: float
    strongest_n: float
    steepest_n: float
    fastest_m_s: float
    cut: int
    slowed: int
    damped: int
    signs: int
    energy_j: float
    late_us: float | None


class FieldVerdict(ServoVerdict):
    """All that is said of a field: on this machine, on every simulated device, on the attached one.

    ``advice`` is what a person should do; ``sha256`` is that of the exported file. ``proxy`` is
    None where there is none: ``no_proxy`` says why.
    """

    devices: dict[str, DeviceVerdict]
    advice: str
    sha256: str
    proxy: ProxyVerdict | None
    no_proxy: str
    attached: AttachedRun | None


class HardwareRecord(Record):
    """The validation of all fields of a mesh."""

    statement: str
    devices: dict[str, dict]
    machine: dict
    locked: bool
    realtime: bool
    rate: float
    deadline: float
    size: float
    stiffness: float
    contact: str
    newtons: float
    clock_alone_us: dict[str, float]
    clock_alone_late_share: float
    fields: dict[str, FieldVerdict]
    reproducible: bool = False

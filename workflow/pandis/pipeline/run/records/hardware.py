"""Verdicts of the hardware validation on every field: the attributes of ``hardware.zarr.zip``."""

from pandis.pipeline.run.ask.contacts import TextureOptions
from pandis.pipeline.run.records.record import Record


class WallVerdict(Record):
    """Comparison of forces below the surface with the exact ones, on parts of every thickness.

    Attributes
    ----------
    missing, felt, judged : float
        Shares of area: see `pandis.pipeline.geometry.shares.shares`.
    left_out : float
        Share of the area whose walls are too thin to be judged.
    strongly_felt, patch, p99_n : float
        Shares of area, and newtons: see `pandis.pipeline.geometry.shares.differences`.
    points : int
        Number of points compared.
    pressed_missing : int
        Number of the points pressed by devices at which the force is missing.
    ghost_n : float
        Largest force in free space away from the surface.
    holds : bool
        The force is missing at no pressed point, and all figures are within their limits.
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
        Damping of the configured hand, Ns/m. All figures are for this hand unless stated
        otherwise.
    hands : dict of str to float
        Largest safe stiffness (N/m) for this hand and others, by the hand's damping.
    released_n_m : float
        Largest safe stiffness with a weight in place of a hand, N/m.
    stiffness : float
        N/m.
    strongest_n, steepest_n_per_ms : float
        Largest force (N), and its largest change (N/ms).
    cut : int
        Ticks at the force limit.
    energy_j : float
        Smallest energy balance of wall and device, J: see ``energy.h``.
    quiet : float
        Share of the presses that reach a wall and do not shake there. Presses that friction may
        have stopped before the wall are ignored.
    unarmed : int
        Presses that were skipped because the field pushed the probe at every height at which the
        press could begin.
    reach_m : float
        Largest distance of the probe from the middle of the workspace, m.
    ended : str
        Why a run ended early; empty if none did.
    within_limits, passive : bool
    safe_n_m : float
        Largest safe stiffness for the hand; ``limited_by`` says why it is no larger.
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
    """Verdict on a field pressed by a simulated device, as a word and as a sentence."""

    device: str
    pressed_missing: int
    holds: bool
    verdict: str
    sentence: str


class TouchVerdict(Pressed):
    """Verdict on a field that a simulated device presses through a proxy.

    Attributes
    ----------
    device : str
    presses : int
        Number of presses, on thin and thick parts, with 1.2 times the device's largest force.
    passes, penalty_passes : int
        Number of presses in which the proxy, or the probe under penalty forces, went through a
        wall.
    deepest_m : float
        Largest depth of a proxy below the surface.
    holds : bool
        As in `WallVerdict`.
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
    """Verdict on a field through a proxy.

    Attributes
    ----------
    radius : float
        Radius of the probe, m.
    materials : dict of str to dict
        Feel of each surface, by material name.
    textures : dict of str to (pandis.pipeline.run.ask.contacts.TextureOptions or None)
        Texture of each surface, by the same names; empty if no surface has one.
    budget : int
        Largest number of queries per tick.
    queries, compute_us : dict of str to float
        Percentiles over the ticks along the trajectory.
    miss_share : float
        Share of ticks that took too long to compute. ``in_time``: this share is small enough, and
        some ticks were in contact.
    touching_share, behind_share : float
        Shares of ticks in contact, and of ticks whose query budget was too small.
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
    """Tick times of a run: percentiles in µs, and shares of ticks beyond the deadline."""

    ticks: int
    compute_us: dict[str, float]
    lateness_us: dict[str, float]
    late_share: float
    miss_share: float


class ServoVerdict(Ticks):
    """Verdict of the servo loop on a field, on this machine.

    Attributes
    ----------
    misses, longest_run_of_misses : int
    agreement : float
        Largest difference from the evaluated forces (unit frame, k = 1).
    agrees, in_time, punctual : bool
        Whether the difference is small enough, few enough ticks take too long to compute, and few
        enough begin too late.
    walls : WallVerdict
    verdict, sentence : str
    loaded : Ticks or None
        Tick times with other work on every core.
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
    """A run on the attached device: what ran, how it ended, and its figures.

    ``contact`` is the kind of forces: ``proxy`` or ``penalty``.
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
    """Full verdict on a field: for this machine, every simulated device and the attached device.

    ``advice`` is a text for the user; ``sha256`` is the digest of the exported file. If there is no
    proxy, ``proxy`` is None and ``no_proxy`` contains the reason.
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

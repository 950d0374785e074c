"""Forces on a haptic device, real or simulated: the binding of ``client.c``."""

import ctypes
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import load
from pandis.engine.layout import compare_layouts
from pandis.runtime.device.errors import ERRORS
from pandis.runtime.device.watchdog import Watchdog

#: Why a run ended: names of ``guard.h``, in its order, with which `library` compares them.
_NAMES = (
    "DONE", "LIBRARY", "DEVICE", "ERROR", "SPEED", "NUMBER", "OVERRUN", "WATCHDOG", "GAP",
    "INTERRUPTED", "CALIBRATION", "SWITCH", "HOT", "UNSTABLE", "BUSY", "LIMITS", "ENCODER",
)  # fmt: skip
(
    DONE, LIBRARY, DEVICE, ERROR, SPEED, NUMBER, OVERRUN, WATCHDOG, GAP, INTERRUPTED, CALIBRATION,
    SWITCH, HOT, UNSTABLE, BUSY, LIMITS, ENCODER,
) = range(len(_NAMES))  # fmt: skip
#: What must be held or closed for a force to be given.
NEEDS_BUTTON, NEEDS_SWITCH = 1, 2
#: Ticks of zero force before a failed run lets go of the device.
RELEASE = 5


class Limits(ctypes.Structure):
    """What no force may go beyond; see ``guard.h``.

    ``force`` and ``continuous`` (largest, and for long; 0: not known), ``step`` (largest addition
    between ticks) and ``impulse`` (largest change between ticks), N; ``speed`` of the probe, m/s;
    ``ramp``, ticks until the whole force is given; ``damping`` (Ns/m) and ``encoder`` (m, a step)
    of the device; ``stiffness`` of the wall, N/m: what energy it can store; ``most_damping`` (Ns/m)
    that may be added; ``needs``: NEEDS_BUTTON, NEEDS_SWITCH, what must be held or closed.
    """

    _fields_ = (
        *(
            (name, ctypes.c_double)
            for name in (
                "force", "continuous", "step", "impulse", "speed", "ramp", "damping",
                "encoder", "stiffness", "most_damping",
            )
        ),
        ("needs", ctypes.c_int),
    )  # fmt: skip


class DeviceReport(ctypes.Structure):
    """What a device says of itself, in metres and newtons; 0 where it says nothing."""

    _fields_ = (
        ("model", ctypes.c_char * 64),
        *((n, ctypes.c_double) for n in ("force", "continuous", "speed", "impulse", "rate")),
        ("low", ctypes.c_double * 3),
        ("high", ctypes.c_double * 3),
        ("has_switch", ctypes.c_int),
    )


class Simulated(ctypes.Structure):
    """A simulated device and the hand that holds it.

    ``mass`` (kg), ``damping`` (Ns/m), ``friction`` (N), ``encoder`` (step of its position, m);
    beyond ``force`` (N), ``impulse`` (N per ms) and ``speed`` (m/s) it reports errors; the hand's
    ``hand_stiffness`` (N/m) and ``hand_damping`` (Ns/m); ``period`` of a tick (s); ``wall``, the
    stiffness of what it meets (N/m); ``delay``, ticks by which a force comes late, at most 20.
    """

    _fields_ = (
        *(
            (name, ctypes.c_double)
            for name in (
                "mass", "damping", "friction", "encoder", "force", "impulse", "speed",
                "hand_stiffness", "hand_damping", "period", "wall",
            )
        ),
        ("delay", ctypes.c_int),
    )  # fmt: skip


#: What C calls.
_BETWEEN = ctypes.CFUNCTYPE(ctypes.c_int)


class _Order(ctypes.Structure):
    _fields_ = (
        ("scene", ctypes.c_void_p),
        ("limits", Limits),
        ("period", ctypes.c_double),
        ("deadline", ctypes.c_double),
        ("overruns", ctypes.c_int),
        ("gap", ctypes.c_double),
        ("patience", ctypes.c_double),
        ("expected", ctypes.c_double),
        ("armed", ctypes.c_int),
        ("ticks", ctypes.c_longlong),
        *((name, ctypes.c_void_p) for name in ("positions", "forces", "taken", "since", "proxies")),
        ("bridge", ctypes.c_void_p),
        ("between", _BETWEEN),
        ("every", ctypes.c_int),
        ("held", ctypes.c_int),
        ("watch", _BETWEEN),
        ("pulse", ctypes.c_void_p),
    )


class _Outcome(ctypes.Structure):
    _fields_ = (
        ("cause", ctypes.c_int),
        ("code", ctypes.c_uint),
        ("stand_in", ctypes.c_int),
        ("simulated", ctypes.c_int),
        ("hangs", ctypes.c_int),
        ("watched", ctypes.c_int),
        ("ticks", ctypes.c_longlong),
        ("worst", ctypes.c_double),
        *((name, ctypes.c_double) for name in ("strongest", "steepest", "fastest", "added")),
        *((n, ctypes.c_longlong) for n in ("cut", "slowed", "damped", "armed_at", "signs")),
        ("spec", DeviceReport),
        ("limits", Limits),
        ("why", ctypes.c_char * 256),
    )


class Session(NamedTuple):
    """What a run on a device came to.

    Attributes
    ----------
    position, force : ndarray, shape (n, 3)
        Per tick: where the device said it was (m), and what was sent (N).
    taken, since : ndarray, shape (n,)
        Per tick: seconds of computing, and since the last call.
    cause : int
        Why it ended: `DONE`, `LIBRARY`, …; `sentence` says it in words.
    code : int
        The device's error, if that is why: `ERRORS`.
    worst : float
        J. The least balance of what the wall took and the device lost in a contact (see
        ``energy.h``): below zero, the wall gave more energy than it had stored and the device lost.
    strongest, steepest, added, fastest : float
        Largest force, change and addition between ticks (N); largest speed (m/s).
    cut, slowed, damped : int
        Ticks in which the force, or its change, was beyond the limit, and those with damping.
    armed_at : int
        The first tick whose force was given, -1 if none was.
    signs : int
        How often energy was missing or the probe shook.
    report : DeviceReport
        What the device says of itself.
    limits : Limits
        What was kept.
    stand_in, simulated : bool
        The library is a stand-in for a device's; there was no library at all.
    why : str
        What the system said of the library.
    proxy : ndarray, shape (n, 3)
        Per tick: of the first object of a scene with contacts that is touched, m; else the
        position.
    path : ndarray, shape (n, 3), or None
        Where a simulated device really was at the end of each tick, m.
    watched : bool
        Whether a process of its own could have ended the force: see ``watchdog.h``.
    """

    position: np.ndarray
    force: np.ndarray
    taken: np.ndarray
    since: np.ndarray
    cause: int
    code: int
    worst: float
    strongest: float
    steepest: float
    fastest: float
    added: float
    cut: int
    slowed: int
    damped: int
    armed_at: int
    signs: int
    report: DeviceReport
    limits: Limits
    stand_in: bool
    simulated: bool
    why: str
    proxy: np.ndarray
    path: np.ndarray | None = None
    watched: bool = False

    @property
    def model(self):
        """What the device calls itself."""
        return self.report.model.decode(errors="replace")

    @property
    def sentence(self):
        """Why the run ended, in words."""
        words = library().client_cause_words(self.cause).decode()
        if self.code:
            known = ERRORS.get(self.code, f"error {self.code:#06x}: see OpenHaptics' manual")
            return f"{words}: {known}"
        return f"{words}: {self.why}" if self.why else words


#: What a callback that never came back may still write to.
_ALIVE = []


@cache
def library():
    """Return the compiled library with its functions' types declared.

    Raises
    ------
    PandisError
        It has other structures, or other causes, than this module.
    """
    lib = load(Path(__file__).with_name("client.c"))
    mirrors = {
        "guard_limits": Limits, "device_spec": DeviceReport, "simulated_spec": Simulated,
        "client_order": _Order, "client_outcome": _Outcome,
    }  # fmt: skip
    compare_layouts(lib.client_layout, mirrors)
    pointer, text = ctypes.c_void_p, ctypes.c_char_p
    for function in (lib.client_cause_name, lib.client_cause_words):
        function.argtypes, function.restype = [ctypes.c_int], text
    names = tuple((lib.client_cause_name(k) or b"").decode() for k in range(len(_NAMES) + 1))
    if names != (*_NAMES, ""):
        raise PandisError(f"causes are {names} in C, and {_NAMES} in Python; change both")
    lib.client_device.argtypes = [text, text, pointer, pointer]
    lib.client_simulated.argtypes = [*[pointer] * 5, ctypes.c_int, *[pointer] * 2]
    size = ctypes.c_size_t
    lib.bridge_bytes.restype = lib.bridge_room.restype = size
    lib.bridge_room.argtypes = [size]
    lib.bridge_open.argtypes = [pointer, pointer, size, pointer]
    lib.bridge_take.argtypes = [pointer, pointer]
    lib.bridge_next.restype, lib.bridge_next.argtypes = pointer, [pointer]
    return lib


class Order(NamedTuple):
    """What is asked of a device.

    Attributes
    ----------
    scene : pandis.runtime.scene.NativeScene
        In metres and newtons of the device's workspace.
    ticks : int
    limits : Limits
    period : float
        Period of a tick, s.
    deadline : float
        A tick that computes longer (s) is an overrun; ``overruns`` of them in a row end the run.
    overruns : int
    gap : float
        Calls further apart than this (s), or a call that takes longer, end the run.
    patience : float
        Seconds without a call after which the watchdog ends the run.
    expected : float
        Largest force (N) of the device that is expected; one whose own is off by more than a
        tenth is another, and is refused. 0: any.
    armed : bool
        Whether forces are sent.
    bridge : object, optional
        To a simulation that moves the scene's objects: see `pandis.bridges.mujoco.bridge`.
    between : callable, optional
        Called every so many ticks (``every``), in the time of ticks alone: a simulation that keeps
        step with the simulated device. What it raises ends the run, and is raised after it.
    every : int
    hold : int
        Ticks for which a force is held before another one is asked for: 1 on any device.

    Notes
    -----
    In the time of ticks nothing is late: deadline, gap and patience are for real devices.
    """

    scene: object
    ticks: int
    limits: Limits
    period: float = 1e-3
    deadline: float = 0.8e-3
    overruns: int = 3
    gap: float = 0.01
    patience: float = 0.05
    expected: float = 0.0
    armed: bool = False
    bridge: object = None
    between: object = None
    every: int = 1
    hold: int = 1


def run_device(path, name, order):
    """Run an order on a device by its library.

    Parameters
    ----------
    path : str
        OpenHaptics' ``libHD.so``.
    name : str
        Name of the device; empty: the default one.
    order : Order

    Returns
    -------
    Session
    """
    _by_the_clock(order)
    lib = library()
    with Watchdog(lib._name, path, name) as watchdog:
        function = partial(lib.client_device, path.encode(), name.encode())
        return _run(order, function, watchdog)


def run_simulated(device, start, rest, press, order, clock=False):
    """Run an order on a simulated device, in the time of ticks, or by a clock.

    Parameters
    ----------
    device : Simulated
    start : ndarray, shape (3,)
        Where it lies at rest at first, m.
    rest, press : ndarray, shape (ticks, 3)
        Where the hand would rest (m), and how it presses (N).
    order : Order
    clock : bool
        Pull it at the order's rate, as a device without a scheduler of its own is.

    Returns
    -------
    Session
    """
    if not 0 <= device.delay <= 20:
        raise ValueError("a force can be late by 0 to 20 ticks")
    if clock:
        _by_the_clock(order)
    columns = [
        np.ascontiguousarray(np.broadcast_to(values, shape), np.float64)
        for values, shape in ((start, 3), (rest, (order.ticks, 3)), (press, (order.ticks, 3)))
    ]
    path = np.zeros((order.ticks, 3))
    places = [column.ctypes.data for column in (*columns, path)]
    pointer = ctypes.byref(device)
    session = _run(order, lambda *ends: library().client_simulated(pointer, *places, clock, *ends))
    return session._replace(path=path[: len(session.position)])


def _by_the_clock(order):
    """Refuse what would keep a device waiting, or its forces old."""
    if order.between is not None or order.hold != 1:
        raise ValueError("between and held are for simulated time: use Bridge.order by the clock")


def _run(order, function, watchdog=None):
    if min(order.ticks, order.every, order.hold) < 1:
        raise ValueError("at least one tick is needed, and between calls and forces, too")
    position, force, proxy = (np.zeros((order.ticks, 3)) for _ in range(3))
    taken, since = np.zeros(order.ticks), np.zeros(order.ticks)
    raised = []

    def between():
        try:
            order.between()
        except BaseException as error:  # C cannot pass it on
            raised.append(error)
        return len(raised)

    order_ = _Order(
        order.scene.address, order.limits, order.period, order.deadline, order.overruns, order.gap,
        order.patience, order.expected, order.armed, order.ticks,
        *(column.ctypes.data for column in (position, force, taken, since, proxy)),
        order.bridge.address if order.bridge else None,
        _BETWEEN(between) if order.between else _BETWEEN(), order.every, order.hold,
        _BETWEEN(watchdog.start) if watchdog else _BETWEEN(),
        ctypes.addressof(watchdog.pulse) if watchdog else None,
    )  # fmt: skip
    ended = _Outcome()
    function(ctypes.byref(order_), ctypes.byref(ended))
    if raised:
        raise raised[0]
    if ended.hangs:  # the callback is still at it, and may come back
        _ALIVE.append((order, order_, ended, watchdog, position, force, taken, since, proxy))
        position, force, taken, since, proxy = (
            v.copy() for v in (position, force, taken, since, proxy)
        )
    count = ended.ticks
    return Session(
        position[:count], force[:count], taken[:count], since[:count], ended.cause, ended.code,
        ended.worst, ended.strongest, ended.steepest, ended.fastest, ended.added, ended.cut,
        ended.slowed, ended.damped, ended.armed_at, ended.signs, ended.spec, ended.limits,
        bool(ended.stand_in), bool(ended.simulated), ended.why.decode(errors="replace"),
        proxy[:count], watched=bool(ended.watched),
    )  # fmt: skip

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

#: Causes of a run's end, in the order of ``guard.h``; `library` checks that they agree.
_NAMES = (
    "DONE", "LIBRARY", "DEVICE", "ERROR", "SPEED", "NUMBER", "OVERRUN", "WATCHDOG", "GAP",
    "INTERRUPTED", "CALIBRATION", "SWITCH", "HOT", "UNSTABLE", "BUSY", "LIMITS", "ENCODER",
)  # fmt: skip
(
    DONE, LIBRARY, DEVICE, ERROR, SPEED, NUMBER, OVERRUN, WATCHDOG, GAP, INTERRUPTED, CALIBRATION,
    SWITCH, HOT, UNSTABLE, BUSY, LIMITS, ENCODER,
) = range(len(_NAMES))  # fmt: skip
#: Conditions for sending a force: the button is held, the safety switch is closed.
NEEDS_BUTTON, NEEDS_SWITCH = 1, 2
#: Ticks of zero force before a failed run releases the device.
RELEASE = 5


class Limits(ctypes.Structure):
    """Limits on forces; see ``guard.h``.

    Forces, N: ``force`` (peak), ``continuous`` (sustained; 0: unknown), ``step`` (largest addition
    between ticks) and ``impulse`` (largest change between ticks). ``speed``: of the probe, m/s.
    ``ramp``: ticks until the full force is reached. ``damping`` (Ns/m) and ``encoder`` (position
    step, m): of the device. ``stiffness``: of the wall, N/m, which bounds the energy it stores.
    ``most_damping``: may be added, Ns/m. ``needs``: NEEDS_BUTTON, NEEDS_SWITCH, where they apply.
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
    """Properties that a device reports, in metres and newtons; 0: not reported."""

    _fields_ = (
        ("model", ctypes.c_char * 64),
        *((n, ctypes.c_double) for n in ("force", "continuous", "speed", "impulse", "rate")),
        ("low", ctypes.c_double * 3),
        ("high", ctypes.c_double * 3),
        ("has_switch", ctypes.c_int),
    )


class Simulated(ctypes.Structure):
    """A simulated device and the hand that holds it.

    The device's ``mass`` (kg), ``damping`` (Ns/m), ``friction`` (N) and ``encoder`` (position step,
    m). Limits beyond which it reports errors: ``force`` (N), ``impulse`` (N per ms), ``speed``
    (m/s). The hand's ``hand_stiffness`` (N/m) and ``hand_damping`` (Ns/m). ``period`` of a tick, s.
    ``wall``: stiffness of the touched surface, N/m. ``delay`` of forces: at most 20 ticks.
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


#: Type of the callbacks from C.
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
    """Results of a run on a device.

    Attributes
    ----------
    position, force : ndarray, shape (n, 3)
        Per tick: position reported by the device (m), and force sent (N).
    taken, since : ndarray, shape (n,)
        Per tick: computing time, and time since the last call, s.
    cause : int
        Why the run ended: `DONE`, `LIBRARY`, …; `sentence` explains it.
    code : int
        The device's error (`ERRORS`), if that is the cause.
    worst : float
        Smallest energy balance of a contact (see ``energy.h``), J. If negative, the wall returned
        more energy than it had stored and the device had dissipated.
    strongest, steepest, added, fastest : float
        Largest force, change and addition between ticks (N); largest speed (m/s).
    cut, slowed, damped : int
        Numbers of ticks in which the guard limited the force, limited its change, or damped it.
    armed_at : int
        The first tick whose force was sent; -1 if there was none.
    signs : int
        Number of times that energy was missing or the probe shook.
    report : DeviceReport
        Properties that the device reported.
    limits : Limits
        Limits in effect.
    stand_in, simulated : bool
        Whether the library is a stand-in, and whether the run used no library at all.
    why : str
        Details of the cause, such as the system's error for the library.
    proxy : ndarray, shape (n, 3)
        Per tick, m: the proxy on the first touched object of a scene with contacts; if there is
        none, the position.
    path : ndarray, shape (n, 3), or None
        True position of a simulated device at the end of each tick, m.
    watched : bool
        Whether a separate process stood ready to end the force: see ``watchdog.h``.
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
        """Model name reported by the device."""
        return self.report.model.decode(errors="replace")

    @property
    def sentence(self):
        """Why the run ended, in words."""
        words = library().client_cause_words(self.cause).decode()
        if self.code:
            known = ERRORS.get(self.code, f"error {self.code:#06x}: see the OpenHaptics manual")
            return f"{words}: {known}"
        return f"{words}: {self.why}" if self.why else words


#: Objects kept alive because a callback that has not returned may still use their memory.
_ALIVE = []


@cache
def library():
    """Return the compiled library with its functions' types declared.

    Raises
    ------
    PandisError
        The library's structures or causes differ from those of this module.
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
        raise PandisError(f"the causes are {names} in C but {_NAMES} in Python; make them agree")
    lib.client_device.argtypes = [text, text, pointer, pointer]
    lib.client_simulated.argtypes = [*[pointer] * 5, ctypes.c_int, *[pointer] * 2]
    size = ctypes.c_size_t
    lib.bridge_bytes.restype = lib.bridge_room.restype = size
    lib.bridge_room.argtypes = [size]
    lib.bridge_open.argtypes = [pointer, pointer, size, pointer]
    lib.bridge_take.argtypes = lib.bridge_dropped.argtypes = [pointer, pointer]
    lib.bridge_next.restype, lib.bridge_next.argtypes = pointer, [pointer]
    return lib


class Order(NamedTuple):
    """Specification of a run on a device.

    Attributes
    ----------
    scene : pandis.runtime.scene.NativeScene
        The scene to render, in metres and newtons of the device's workspace.
    ticks : int
    limits : Limits
    period : float
        Period of a tick, s.
    deadline : float
        Longest computing time of a tick, s. After ``overruns`` longer ticks in a row, the run ends.
    overruns : int
    gap : float
        The run ends if the time between two calls, or the duration of a call, exceeds this (s).
    patience : float
        The watchdog ends the run after this time without a call, s.
    expected : float
        Expected largest force of the device, N. A device is refused if its largest force differs
        from this by more than a tenth. 0 accepts any device.
    armed : bool
        Whether forces are sent to the device.
    bridge : object, optional
        Bridge to a simulation that moves the scene's objects: see `pandis.bridges.mujoco.bridge`.
    between : callable, optional
        Function called every ``every`` ticks, in simulated time only, for example to advance a
        simulation. An exception in it ends the run, and is raised again afterwards.
    every : int
    hold : int
        Number of ticks for which each computed force is held; must be 1 in real time.

    Notes
    -----
    ``deadline``, ``gap`` and ``patience`` apply only in real time; simulated ticks are never late.
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
    """Run an order on a device through its library.

    Parameters
    ----------
    path : str
        Path of OpenHaptics' ``libHD.so``.
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


def run_simulated(device, start, rest, *, press, order, clock=False):
    """Run an order on a simulated device, in simulated time or in real time.

    Parameters
    ----------
    device : Simulated
    start : ndarray, shape (3,)
        Initial position, at rest, m.
    rest, press : ndarray, shape (ticks, 3)
        The hand's rest position (m) and force (N).
    order : Order
    clock : bool
        Whether to run at the order's rate in real time, like a device without a scheduler.

    Returns
    -------
    Session
    """
    if not 0 <= device.delay <= 20:
        raise ValueError("delay must be from 0 to 20 ticks")
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
    """Raise ValueError for options that would delay a device or its forces."""
    if order.between is not None or order.hold != 1:
        raise ValueError("between and hold require simulated time: use Bridge.order in real time")


def _run(order, function, watchdog=None):
    if min(order.ticks, order.every, order.hold) < 1:
        raise ValueError("at least one tick is needed, and every and hold must be at least 1")
    position, force, proxy = (np.zeros((order.ticks, 3)) for _ in range(3))
    taken, since = np.zeros(order.ticks), np.zeros(order.ticks)
    raised = []

    def between():
        try:
            order.between()
        except BaseException as error:  # C cannot propagate it
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
    if ended.hangs:  # the callback is still running, and may return later
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

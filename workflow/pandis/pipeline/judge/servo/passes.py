"""Tests whether a hand can press through a wall: presses on thin places, judged by libigl.

A simulated hand presses a device from outside at a slant with increasing force, up to the device's
largest force or more. It holds this force, then withdraws along the same line. The judgement uses
neither the field under test nor the tree from which the field was made: libigl computes distances
and sides, and crossings of the surface are computed from the triangles.
"""

from typing import NamedTuple

import igl
import numpy as np
from scipy.spatial.distance import cdist

from pandis.runtime.device import DONE, Order, run_simulated
from pandis.runtime.scene import NativeScene, Placed

#: A proxy has gone through a wall if its depth exceeds the field's largest surface error by more
#: than this (m). Before the path between two successive positions of a proxy is tested, both are
#: moved at least this far outside.
MARGIN = 5e-5
#: Distance (m) from the start of a press to its surface point.
ABOVE = 3e-3
#: Durations of waiting, pressing, holding and withdrawing, s.
_TIMES = 0.03, 0.35, 0.1, 0.35
#: Seconds over which the force ramps up. The ramp ends before the surface is reached.
_RAMP = 0.02
#: _HAND is the stiffness (N/m) and damping (Ns/m) of the hand, _HARD its force as a multiple of the
#: device's largest.
_HAND, _HARD = (400.0, 3.0), 1.2
#: Number of runs whose proxies are passed to libigl in one call.
_TOGETHER = 500
#: At distances below this (m), the direction to the closest point is dominated by rounding.
_ON_IT = 1e-7
#: Longest free path that is searched for, as a multiple of the straight line.
_DETOUR = 2.0
#: Rounds of the search for a path around an obstacle.
_ROUNDS = 60
#: Each round extends at most _GROWN balls, by _RIM new balls on the rim of each.
_GROWN, _RIM = 48, 10
#: Smallest radius of a ball, as a share of the margin.
_LEAST = 0.02
#: Number of faces that are tested against a segment at a time.
_SOME = 4096


class Press(NamedTuple):
    """A press: its start, and the target of the hand, m.

    Attributes
    ----------
    start, end : ndarray, shape (3,)
        Start outside the object, and where the hand would go if nothing stopped it.
    """

    start: np.ndarray
    end: np.ndarray


class Judged(NamedTuple):
    """Outcome of presses.

    Attributes
    ----------
    presses, ended : int
        Number of all presses, and of those that the guard ended early.
    deep, crossed : int
        Number of presses whose proxy was too deep, and of those whose proxy crossed triangles.
    around : int
        Number of presses whose proxy crossed nothing, but is apart from the withdrawn probe in the
        end: it slid around a part of the object, which is not a pass.
    deepest : float
        Largest depth of a proxy below the surface, m.
    """

    presses: int
    ended: int
    deep: int
    crossed: int
    around: int
    deepest: float

    @property
    def passed(self):
        """Number of presses in which the hand passed through the surface."""
        return self.deep + self.crossed


def draw(places, spec, stiffness, *, slant, rng, above=ABOVE):
    """Draw presses on surface points.

    Parameters
    ----------
    places : tuple of ndarray, shape (n, 3)
        Surface points (m) and their outward normals.
    spec : pandis.pipeline.judge.servo.devices.Specification
    stiffness : float
        Stiffness of the object, N/m.
    slant : float
        Largest angle between a press and the normal, rad.
    rng : numpy.random.Generator
    above : float
        Distance from the start of a press to its surface point, m.

    Returns
    -------
    list of Press
    """
    presses = []
    for foot, normal in zip(*places, strict=True):
        side = rng.normal(size=3)
        side -= (side @ normal) * normal
        angle = rng.uniform(0, slant)
        way = -np.cos(angle) * normal + np.sin(angle) * side / np.linalg.norm(side)
        far = _HARD * spec.force * (1 / _HAND[0] + 1 / stiffness)
        presses.append(Press(foot - above * way, foot + far * way))
    return presses


class Oracle:
    """Finds sides (inside or outside), distances and crossings of a mesh, by libigl and arithmetic.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), m
    faces : ndarray, shape (F, 3)
    """

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int64)
        corners = self.vertices[self.faces]
        self._corners, self._low, self._high = corners, corners.min(axis=1), corners.max(axis=1)

    def look(self, points):
        """Return signed distances (n,) of points (n, 3), m, and their unit gradients (n, 3).

        Distances are negative inside. At a surface point the gradient is the face's normal.
        """
        kind = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
        points = np.ascontiguousarray(points, np.float64)
        distance, face, closest, _ = igl.signed_distance(points, self.vertices, self.faces, kind)
        away = (points - closest) * np.sign(distance)[:, None]
        a, b, c = self._corners[face].transpose(1, 0, 2)
        on_it = np.abs(distance) < _ON_IT
        away[on_it] = np.cross(b - a, c - a)[on_it]
        return distance, away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None]

    def crosses(self, start, end):
        """Return whether the segment from one point (3,) to another crosses a triangle."""
        low, high = np.minimum(start, end), np.maximum(start, end)
        near = np.flatnonzero(((self._low <= high) & (self._high >= low)).all(axis=1))
        return any(self._hits(start, end, near[i : i + _SOME]) for i in range(0, len(near), _SOME))

    def _hits(self, start, end, which):
        a, b, c = self._corners[which].transpose(1, 0, 2)
        before, after = (
            np.einsum("ij,ij->i", np.cross(b - a, c - a), point - a) for point in (start, end)
        )
        way = np.broadcast_to(end - start, a.shape)
        sides = [np.einsum("ij,ij->i", way, np.cross(p - start, q - start))
                 for p, q in ((a, b), (b, c), (c, a))]  # fmt: skip
        inside = np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
        return bool((inside & (before * after < 0)).any())


def free_starts(presses, oracle, above=ABOVE):
    """Return the presses that begin outside the mesh, regardless of any field.

    Parameters
    ----------
    presses : list of Press
    oracle : Oracle
    above : float
        Intended height of the starts above the surface, m; a third of it is sufficient.

    Returns
    -------
    list of Press
    """
    starts = np.array([press.start for press in presses]).reshape(-1, 3)
    free = oracle.look(starts)[0] > above / 3
    return [presses[i] for i in np.flatnonzero(free)]


def run(field, spec, size, *, stiffness, presses, feel=None):
    """Press with a simulated device; yield each press's session and proxy positions (n, 3), m.

    Parameters
    ----------
    field : pandis.runtime.field.NativeField
    spec : pandis.pipeline.judge.servo.devices.Specification
    size, stiffness : float
        Longest side, m; stiffness, N/m.
    presses : list of Press
    feel : pandis.runtime.contact.Feel, optional
        Probe with a proxy, and its surface. If None, the force is the penalty force, and the
        probe's last place outside counts as its proxy.
    """
    period = 1 / spec.rate
    share = np.concatenate([
        np.zeros(round(_TIMES[0] / period)), np.linspace(0, 1, round(_TIMES[1] / period)),
        np.ones(round(_TIMES[2] / period)), np.linspace(1, 0, round(_TIMES[3] / period)),
        np.zeros(round(_TIMES[0] / period)),
    ])[:, None]  # fmt: skip
    placed = Placed.at(field, size, stiffness)
    scene = feel.scene(placed) if feel else NativeScene([placed])
    limits = spec.limits(period, stiffness)
    limits.ramp = _RAMP / period
    order = Order(scene, len(share), limits, period, armed=True)
    device = spec.simulated(_HAND, delay=0, period=period, wall=stiffness)
    for press in presses:
        if feel:
            scene.restart()
        rest = press.start + share * (press.end - press.start)
        session = run_simulated(device, press.start, rest, press=np.zeros(3), order=order)
        proxy = session.proxy
        if not feel:
            inside = scene.ask_all(session.position).any(axis=1)
            last = np.maximum.accumulate(np.where(inside, 0, np.arange(len(inside))))
            proxy = session.position[last]
        yield session, proxy


def judge(runs, oracle, error, *, detours=True, radius=0.0):
    """Judge in how many runs of presses the hand passed through the surface.

    Parameters
    ----------
    runs : iterable of (pandis.runtime.device.Session, ndarray)
        Session and proxy positions of each press, from `run`.
    oracle : Oracle
    error : float
        The field's largest error at the surface, m.
    detours : bool
        Whether a proxy may go around an obstacle within a tick. Set this to False for penalty
        forces: a probe that enters the object and comes out elsewhere has gone through, not around.
    radius : float
        Radius of the probe, m. Proxies must stay at least this far outside the surface.

    Returns
    -------
    Judged
    """
    margin, passes = error + MARGIN, []
    followed = [_Run.of(session, proxies) for session, proxies in runs]
    for some in range(0, len(followed), _TOGETHER):
        group = followed[some : some + _TOGETHER]
        looks = oracle.look(np.concatenate([run.places for run in group]))
        ends = np.cumsum([len(run.places) for run in group])[:-1]
        parts = zip(*(np.split(column, ends) for column in looks), strict=True)
        for run, (distance, outward) in zip(group, parts, strict=True):
            depth = radius - distance.min()
            fault = (
                "deep"
                if depth > margin
                else _fault(run, distance, outward, margin=margin, oracle=oracle, detours=detours)
            )
            passes.append((fault, depth))
    faults = [fault for fault, _ in passes]
    return Judged(
        presses=len(followed),
        ended=sum(run.ended for run in followed),
        **{name: faults.count(name) for name in ("deep", "crossed", "around")},
        deepest=max((float(depth) for _, depth in passes), default=0.0),
    )


class _Run(NamedTuple):
    """Successive distinct places of a proxy, and its final distance from the probe, m."""

    places: np.ndarray
    ended: bool
    apart: float

    @classmethod
    def of(cls, session, proxies):
        if session.cause != DONE:  # after an early end there were no queries
            pushed = np.flatnonzero(session.force.any(axis=1))
            proxies = proxies[: pushed[-1] + 1 if len(pushed) else 1]
        moved = np.concatenate([[True], (np.diff(proxies, axis=0) != 0).any(axis=1)])
        apart = float(np.linalg.norm(proxies[-1] - session.position[-1]))
        return cls(proxies[moved], session.cause != DONE, apart)


def _fault(run, distance, outward, *, margin, oracle, detours=True):
    """Return the fault, if any, of a run whose proxy was never too deep."""
    # a proxy can cross a wall two margins thick without being deeper than one margin
    for i in np.flatnonzero(np.linalg.norm(np.diff(run.places, axis=0), axis=1) > 2 * margin):
        if _through(
            run.places[i : i + 2],
            distance[i : i + 2],
            outward[i : i + 2],
            margin=margin,
            oracle=oracle,
            detours=detours,
        ):
            return "crossed"
    return "around" if run.apart > MARGIN and not run.ended else None


def _through(places, distance, outward, *, margin, oracle, detours):
    """Return whether a proxy went through: no free path nearby connects its two places (2, 3).

    The proxy's path between ticks is unknown. The straight segment is tested first, with
    its ends moved outward until they are at least a margin outside. Then paths up to `_DETOUR`
    times as long are tested, through balls that are free according to libigl's distances.
    """
    length = np.linalg.norm(places[1] - places[0])
    if length <= np.maximum(0.0, distance).sum():
        return False
    lifted = places + (np.maximum(distance, margin) - distance)[:, None] * outward
    if not oracle.crosses(*lifted):
        return False
    return not (detours and _leads_around(places, margin, oracle, longest=_DETOUR * length))


def _leads_around(places, margin, oracle, *, longest):
    """Return whether a chain of overlapping free balls leads from one place to the other.

    A proxy may be off by a margin, so any ball within a margin of a place is connected to it. New
    balls are added on the rims of others, nearest to the goal first, within the ellipsoid of paths
    no longer than ``longest``.
    """
    rng, (start, goal) = np.random.default_rng(0), places
    inside = rng.normal(size=(_GROWN, 3))
    inside *= margin * np.cbrt(rng.random((_GROWN, 1))) / np.linalg.norm(inside, axis=1)[:, None]
    tried, centres, radius = start + inside, np.empty((0, 3)), np.empty(0)
    grown = np.zeros(0, bool)
    for _ in range(_ROUNDS):
        way = np.linalg.norm(tried - start, axis=1) + np.linalg.norm(tried - goal, axis=1)
        tried = tried[way <= longest]
        free = oracle.look(tried)[0] if len(tried) else np.empty(0)
        new = (free > _LEAST * margin) & (cdist(tried, centres) >= radius / 2).all(axis=1)
        centres, radius = np.concatenate([centres, tried[new]]), np.append(radius, free[new])
        grown = np.append(grown, np.zeros(new.sum(), bool))
        left = np.linalg.norm(centres - goal, axis=1) - radius
        if (left <= margin).any():
            return True
        chosen = np.argsort(np.where(grown, np.inf, left), kind="stable")[:_GROWN]
        chosen = chosen[~grown[chosen]]
        if not len(chosen):
            return False
        grown[chosen] = True
        away = rng.normal(size=(len(chosen), _RIM, 3))
        away /= np.linalg.norm(away, axis=2, keepdims=True)
        tried = (centres[chosen, None] + radius[chosen, None, None] * away).reshape(-1, 3)
    return False

"""Tests whether a proxy on a field holds, comes to rest, adds no energy and stays out of walls."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.shares import MISSING_LIMIT, missing
from pandis.pipeline.judge.stress.physical import TICK
from pandis.pipeline.judge.stress.work import SPEED
from pandis.runtime.contact import TOUCHING, Material, NativeContact
from pandis.runtime.scene import Placed

#: STICKS is the friction coefficient of pressed surfaces. Presses move sideways by SHARE of the way
#: to the edge of the friction cone.
STICKS, SHARE = 0.6, 0.5
#: A press starts at height ABOVE (unit frame) over a surface point and goes to DEPTH (m) below it,
#: however thin the wall. The probe moves down for DOWN ticks and sideways for ASIDE ticks, and then
#: rests for REST ticks. The proxy may still move in the first SETTLES of these.
DEPTH, ABOVE = 1e-3, 0.03
DOWN, ASIDE, REST, SETTLES = 60, 20, 100, 50
#: Each surface point must push back with at least HOLDS times the exact field's force. A proxy at
#: rest moves by less than RESTS (m).
HOLDS, RESTS = 0.5, 1e-5
#: Loops are thinned to one step in EVERY. LEAD ticks lead up to the first step.
EVERY, LEAD = 8, 60
#: On the long path, the proxy is compared with the mesh at one tick in LOOKED. It may be deeper
#: than the field's surface error by up to MARGIN (m).
LOOKED, MARGIN = 10, 5e-5
#: The long path takes _STAGE ticks from above a surface point into its wall, and as many to above
#: the next point. It goes _INTO deep and _OUT high (unit frame).
_STAGE, _INTO, _OUT = 20, 0.05, 0.15


class Steps(NamedTuple):
    """Force and proxy at each tick, as the probe follows a path.

    Attributes
    ----------
    force : ndarray, shape (n, 3), N
    proxy : ndarray, shape (n, 3), unit frame
    state : ndarray, shape (n,)
    slide : float
        Distance by which the proxy may move farther than the probe in a tick (unit frame).
    """

    force: np.ndarray
    proxy: np.ndarray
    state: np.ndarray
    slide: float


class Felt(NamedTuple):
    """Follows paths in the unit frame with a proxy.

    Attributes
    ----------
    placed : pandis.runtime.scene.Placed
    scale : pandis.base.physical.Scale
    """

    placed: Placed
    scale: object

    @classmethod
    def of(cls, field, scale):
        """Return the `Felt` of an `ExportedField`; None if the field has no proxy."""
        file = getattr(field, "file", None)
        if file is None:
            return None
        placed = Placed.at(file, scale.size, scale.stiffness)
        try:
            NativeContact(placed)
        except PandisError:
            return None
        return cls(placed, scale)

    def __call__(self, path, material=None):
        """Follow a path (n, 3), without friction or with a `Material`; return `Steps`."""
        contact = NativeContact(self.placed, material=material or Material())
        touches = contact.follow(path / self.scale.metre, TICK)
        proxies = touches.proxy * self.scale.metre
        slide = contact.options.slide * TICK * self.scale.metre
        return Steps(touches.force, proxies, touches.state, slide)


def nothing(path, material=None):
    """Follow a path as if there were no surface: a control that must fail at least one question."""
    return Steps(np.zeros_like(path), path, np.zeros(len(path), np.int32), np.inf)


class Presses(NamedTuple):
    """Outcome of a press through a proxy at each surface point.

    Attributes
    ----------
    push : ndarray, shape (n,)
        Force along the outward normal at the deepest point, N; at most k·depth.
    creeps : ndarray, shape (n,)
        Whether the proxy still moves in the second half of the ticks at rest.
    """

    push: np.ndarray
    creeps: np.ndarray


def press_all(follow, places, scale):
    """Press into or through the wall at each point, move within the friction cone, and wait.

    Parameters
    ----------
    follow : callable
        A `Felt`.
    places : pandis.pipeline.geometry.places.Stratified
    scale : pandis.base.physical.Scale

    Returns
    -------
    Presses
    """
    depth = DEPTH * scale.metre
    push, creeps = np.zeros(len(places.feet)), np.zeros(len(places.feet), bool)
    for i, (foot, outward) in enumerate(zip(places.feet, places.outward, strict=True)):
        sideways = np.linalg.svd(outward[None])[2][1]
        down = foot + np.linspace(ABOVE, -depth, DOWN)[:, None] * outward
        aside = down[-1] + np.linspace(0, SHARE * STICKS * depth, ASIDE)[:, None] * sideways
        path = np.concatenate([down, aside, np.tile(aside[-1], (REST, 1))])
        steps = follow(path, Material(STICKS, STICKS, 0, 0))
        push[i] = min(steps.force[DOWN - 1] @ outward, depth * scale.newtons)
        rest = steps.proxy[-(REST - SETTLES) :]
        creeps[i] = not np.ptp(rest, axis=0).max() < RESTS * scale.metre
    return Presses(push, creeps)


def holds(follow, places, exact, *, scale):
    """Measure the share of the area on which a proxy holds a hand worse than on the exact field.

    Thin walls are tested too, because the force on a proxy does not depend on a wall's thickness.
    Strips along convex edges are not judged: fields round the edge, so the proxy slides off there.

    Parameters
    ----------
    follow, places, scale
        As for `press_all`.
    exact : Presses
        Presses on the exact field, at the same places.

    Returns
    -------
    dict
        ``soft``: share of the judged area on which the field pushes back with less than half the
        force of the exact field; ``creeps``: share on which the proxy still moves in the second
        half of the ticks at rest, although the exact field's proxy does not; ``worst``: the larger
        of the two shares; ``limit``: limit on both; ``passed``.
    """
    pressed = press_all(follow, places, scale)
    soft = ~(pressed.push >= HOLDS * exact.push)  # NaN counts as soft
    creeps = pressed.creeps & ~exact.creeps
    shares = {name: float(places.weight[which].sum())
              for name, which in (("soft", soft), ("creeps", creeps))}  # fmt: skip
    passed = all(share <= MISSING_LIMIT for share in shares.values())
    return shares | {"worst": max(shares.values()), "limit": MISSING_LIMIT, "passed": passed}


def keeps(follow, engine, paths, *, device):
    """Lead a hand twice around closed loops, without friction, and judge the second round.

    Parameters
    ----------
    follow : callable
        A `Felt`.
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    paths : ndarray, shape (m, STEPS, 3)
        From `pandis.pipeline.judge.stress.work.loops`.
    device : pandis.pipeline.judge.stress.physical.Device

    Returns
    -------
    dict
        ``push_n``: the largest work that the hand gains on a loop, divided by the loop's length, N;
        ``limit``: the device's damping force at `pandis.pipeline.judge.stress.work.SPEED`, N;
        ``passed``.
    """
    gained = []
    distance, normal = engine.distance_and_normal(paths[:, 0], check=False)
    above = paths[:, 0] + (ABOVE - distance)[:, None] * normal  # where the proxy starts
    for path, start in zip(paths, above, strict=True):
        loop = path[::EVERY]
        way = np.concatenate([np.linspace(start, loop[0], LEAD), loop, loop, loop[:1]])
        force = follow(way).force[-len(loop) - 1 :]
        moved = np.diff(way[-len(loop) - 1 :], axis=0)
        work = np.einsum("ij,ij->", (force[:-1] + force[1:]) / 2, moved)
        gained.append(work / np.linalg.norm(moved, axis=1).sum())
    push, limit = float(np.max(gained)), device.damping * SPEED
    return {"push_n": push, "limit": limit, "passed": bool(push <= limit)}


def stays(follow, engine, error, *, path, scale):
    """Follow a long smooth path into and out of walls; judge force changes and proxy depth.

    Parameters
    ----------
    follow : callable
        A `Felt`.
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    error : float
        Largest error of the field at the surface (unit frame).
    path : ndarray, shape (n, 3)
        From `wander`.
    scale : pandis.base.physical.Scale

    Returns
    -------
    dict
        ``ticks``: length of the path; ``bad``: number of faults. A fault is a proxy that is not
        finite, or a force change of more than k · (2 · the probe's move + `Steps.slide`) in a tick.
        ``deepest_mm``: largest depth of a proxy below the exact surface; ``limit``: limit on
        ``deepest_mm``, the field's error plus `MARGIN`, mm; ``touching``: share of ticks with
        contact; ``passed``: there is contact, there are no faults, and the depth is within the
        limit.
    """
    steps = follow(path)
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    change = np.linalg.norm(np.diff(steps.force, axis=0), axis=1)
    within = change <= (2 * moved + steps.slide) * scale.newtons + 1e-9
    bad = int((~within).sum() + (~np.isfinite(steps.proxy)).any(axis=1).sum())
    places = steps.proxy[::LOOKED]
    places = places[np.isfinite(places).all(axis=1)]
    deep = -engine.distance_and_normal(places, check=False)[0]
    deepest, limit = float(deep.max(initial=0)), error + MARGIN * scale.metre
    per, touching = 1e3 / scale.metre, float(((steps.state & TOUCHING) > 0).mean())
    return {
        "ticks": len(path),
        "bad": bad,
        "deepest_mm": max(deepest, 0) * per,
        "limit": limit * per,
        "touching": touching,
        "passed": bool(bad == 0 and deepest <= limit and touching > 0),
    }


def wander(places, rng):
    """Return a smooth path (n, 3), unit frame, into the wall at every place and out again.

    Parameters
    ----------
    places : pandis.pipeline.geometry.places.Stratified
    rng : numpy.random.Generator
    """
    order = np.repeat(rng.permutation(len(places.feet)), 2)
    height = np.where(np.arange(len(order)) % 2, -_INTO, _OUT)[:, None]
    stations = CubicSpline(range(len(order)), places.feet[order] + height * places.outward[order])
    path = stations(np.arange(_STAGE * (len(order) - 1)) / _STAGE)
    path[0] = 5.0  # outside of any object
    return path


def surface_error(field, contacts):
    """Return the largest absolute distance that a field gives on the exact surface, unit frame.

    Points below which the force is missing are skipped. Otherwise, a hole in the field would raise
    the limit on a proxy's depth.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    contacts : pandis.pipeline.geometry.measure.ContactSet
    """
    probes = contacts.pressed
    force = penalty_force(*field.answer(probes.points))
    gone = missing(force, probes.force, probes.wall, newtons=probes.scale.newtons)
    feet = (probes.points - probes.distance[:, None] * probes.normal)[~gone]
    return float(np.abs(field.answer(feet)[0]).max(initial=0))

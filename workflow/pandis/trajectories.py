"""The path that a probe takes over a mesh, below its surface, traced on exact data."""

import numpy as np

from pandis.errors import PandisError
from pandis.mesh.shapes import Sphere

_TRIES = 24
#: Turns of a spiral.
TURNS = 6


def trace(surface, engine, options, progress):
    """Trace a smooth path at a smoothly varying depth.

    From sample to sample the probe moves one step along the surface, its
    heading turning slowly at random, and is then brought to the depth wanted
    by Newton steps on the exact distance. Where it would not get there (a part
    thinner than twice the depth) or would come out on another side, it
    turns away.

    Parameters
    ----------
    surface : pandis.sampling.Surface
    engine : object
        From `pandis.distance.open_distance`.
    options : dict
        See `pandis.config.TrajectoryOptions`; and ``seed``.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    dict of str to ndarray
        ``points`` (n, 3), ``distance`` (n,), ``normal`` (n, 3): float64, unit frame, exact.

    Raises
    ------
    PandisError
        No place on the mesh is thick enough for the depths asked for, or a spiral is asked
        for on something else than a sphere.
    """
    if options["kind"] == "spiral":
        return _spiral(engine, options["samples"])
    rng = np.random.default_rng(options["seed"])
    count, step = options["samples"], options["step"]
    depth = _depths(count, options["shallow"], options["deep"], rng)
    report = progress("trajectory", count, "samples")
    tracer = _Tracer(engine, step)
    starts, normals, _, _ = surface.draw(1000, rng)
    points, distances, found_normals = np.empty((count, 3)), np.empty(count), np.empty((count, 3))
    done, heading, restarts = 0, None, 0
    while done < count:
        if heading is None:
            state = None
            while state is None:
                if restarts == len(starts):
                    raise PandisError(
                        "no part of the mesh is thick enough for the trajectory: reduce "
                        f"trajectory.deep (now {options['deep']:g} of the unit frame)"
                    )
                pick = restarts * 617 % len(starts)  # spread over the surface
                seed_point = starts[pick] - depth[done] * normals[pick]
                state = tracer.settle(seed_point, normals[pick], depth[done], reach=step)
                restarts += 1
            heading = rng.normal(size=3)
        else:
            heading = heading + rng.normal(0, 0.025, 3)
            state, heading = tracer.advance(
                points[done - 1], found_normals[done - 1], heading, depth[done], rng
            )
            if state is None:
                heading = None
                continue
        points[done], distances[done], found_normals[done] = state
        done += 1
        report.update(done)
    return {"points": points, "distance": distances, "normal": found_normals}


class _Tracer:
    def __init__(self, engine, step):
        self.engine, self.step = engine, step

    def settle(self, point, normal, depth, reach):
        """Bring a point to the depth; None if it ends elsewhere, turned or too far away."""
        start, now = point, normal
        for _ in range(6):
            distance, found = self.engine.distance_and_normal(point[None])
            error, now = distance[0] + depth, found[0]
            if abs(error) < 1e-3 * depth:
                break
            point = point - error * now
        distance, found = self.engine.distance_and_normal(point[None])
        well = abs(distance[0] + depth) < 0.02 * depth and distance[0] < 0
        near = np.linalg.norm(point - start) < 3 * reach
        same_side = found[0] @ normal > 0.0
        return (point, distance[0], found[0]) if well and near and same_side else None

    def advance(self, point, normal, heading, depth, rng):
        """Take one step; turn more and more until one succeeds."""
        for attempt in range(_TRIES):
            along = heading - (heading @ normal) * normal
            length = np.linalg.norm(along)
            if length > 1e-6:
                heading = along / length
                state = self.settle(point + self.step * heading, normal, depth, reach=self.step)
                if state is not None:
                    return state, heading
            heading = heading + rng.normal(0, 0.3 * (attempt + 1), 3)
        return None, None


def _spiral(engine, count):
    """Return a path of six turns around a sphere, 2 to 5 % of its radius deep."""
    shape = getattr(engine, "shape", None)
    if not isinstance(shape, Sphere):
        raise PandisError("trajectory.kind: a spiral is for analytic:sphere; set it to surface")
    radius = shape.radius * engine.frame.scale
    share = np.arange(count) / max(count - 1, 1)
    polar, around = np.pi * share, 2 * np.pi * TURNS * share
    depth = radius * (0.035 + 0.015 * np.sin(2 * np.pi * 3 * share))
    direction = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    points = (radius - depth)[:, None] * np.stack(direction, axis=1)
    distance, normal = engine.distance_and_normal(points)
    return {"points": points, "distance": distance, "normal": normal}


def _depths(count, shallow, deep, rng):
    """Return depths that wander smoothly from ``shallow`` to ``deep`` and back."""
    time = np.arange(count) / max(count - 1, 1)
    wave = sum(
        np.sin(2 * np.pi * (cycles * time + rng.random())) / cycles**0.5 for cycles in (3, 7, 13)
    )
    share = (wave - wave.min()) / np.ptp(wave)
    return shallow + (deep - shallow) * share

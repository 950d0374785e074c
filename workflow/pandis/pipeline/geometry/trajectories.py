"""Traces a probe's path below the surface of a mesh, with exact distances."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.shapes import Sphere
from pandis.pipeline.geometry.thickness import inscribed_radius

_TRIES = 24
#: Largest depth of a path that follows the thickness, as a share of the inscribed radius.
_OF_RADIUS = 0.8
#: Turns of a spiral.
TURNS = 6


def trace(body, options, seed, *, progress):
    """Trace a smooth path at a smoothly varying depth.

    At each sample the probe moves one step along the surface, in a heading that turns slowly at
    random. Newton steps on the exact distance then bring it to the required depth. Where it cannot
    reach that depth (in a part thinner than twice the depth), or would come out on another side, it
    turns away. If no path has the required depths, the depth follows the thickness: it is at most
    0.8 of the inscribed radius everywhere.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    options : pandis.pipeline.run.ask.options.TrajectoryOptions
    seed : int or list of int
    progress : pandis.base.progress.Progress

    Returns
    -------
    arrays : dict of str to ndarray
        ``points`` (n, 3), ``distance`` (n,), ``normal`` (n, 3): float64, unit frame, exact.
    attributes : dict
        ``followed``: a note for the report if the depth follows the thickness; else empty.

    Raises
    ------
    PandisError
        No path fits the mesh at any depth, or a spiral is requested for an object that is
        not a sphere.
    """
    if options.kind == "spiral":
        return _spiral(body.distance, options.samples), {"followed": ""}
    path = _walk(body, options, seed, progress=progress, follow=False)
    if path is not None:
        return path, {"followed": ""}
    path = _walk(body, options, seed, progress=progress, follow=True)
    if path is None:
        raise PandisError(
            "the probe's path fits nowhere on the mesh, at any depth: the mesh's parts are smaller "
            f"than one step; reduce trajectory.step (now {options.step:g} of the unit frame)"
        )
    deepest = -path["distance"].min()
    return path, {
        "followed": f"its parts are too thin for the depths of {options.shallow:g} to "
        f"{options.deep:g} that were requested, so the path follows their thickness and "
        f"is at most {deepest:.2g} deep"
    }


def _walk(body, options, seed, *, progress, follow):
    """Return the arrays of a path; None if it cannot be completed.

    With ``follow``, its depth is at most 0.8 of the inscribed radius.
    """
    rng = np.random.default_rng(seed)
    count, step = options.samples, options.step
    depth = _depths(count, options.shallow, options.deep, rng=rng)
    report = progress("trajectory", count, "samples")
    tracer = _Tracer(body.distance, step, follow)
    starts, normals, _, _ = body.surface.draw(1000, rng)
    points, distances, found_normals = np.empty((count, 3)), np.empty(count), np.empty((count, 3))
    done, heading, restarts = 0, None, 0
    while done < count:
        if heading is None:
            state = None
            while state is None:
                if restarts == len(starts):
                    return None
                pick = restarts * 617 % len(starts)  # spread over the surface
                state = tracer.begin(starts[pick], normals[pick], depth[done])
                restarts += 1
            heading = rng.normal(size=3)
        else:
            heading = heading + rng.normal(0, 0.025, 3)
            state, heading = tracer.advance(
                points[done - 1], found_normals[done - 1], heading, depth=depth[done], rng=rng
            )
            if state is None:
                heading = None
                continue
        points[done], distances[done], found_normals[done] = state
        done += 1
        report.update(done)
    return {"points": points, "distance": distances, "normal": found_normals}


class _Tracer:
    def __init__(self, engine, step, follow):
        self.engine, self.step, self.follow = engine, step, follow

    def begin(self, foot, normal, depth):
        """Return the state below a surface point; None if the depth cannot be reached there."""
        depth = self._within(foot, normal, depth)
        return self.settle(foot - depth * normal, normal, depth, reach=self.step)

    def _within(self, foot, normal, depth):
        """Return the depth; if the path follows the thickness, reduce it where the part is thin."""
        if not self.follow:
            return depth
        radius = inscribed_radius(self.engine, foot[None], normal[None])[0]
        return min(depth, _OF_RADIUS * radius)

    def settle(self, point, normal, depth, *, reach):
        """Move a point to the depth; return None if it misses, changes side or moves too far."""
        start, now = point, normal
        for _ in range(6):
            distance, direction = self.engine.distance_and_normal(point[None])
            error, now = distance[0] + depth, direction[0]
            if abs(error) < 1e-3 * depth:
                break
            point = point - error * now
        distance, direction = self.engine.distance_and_normal(point[None])
        well = abs(distance[0] + depth) < 0.02 * depth and distance[0] < 0
        near = np.linalg.norm(point - start) < 3 * reach
        same_side = direction[0] @ normal > 0.0
        return (point, distance[0], direction[0]) if well and near and same_side else None

    def _step(self, point, normal, heading, *, depth):
        """Take one step along the surface; return the new state, or None."""
        there = point + self.step * heading
        if self.follow:
            distance, outward = self.engine.distance_and_normal(there[None], check=False)
            foot = there - distance[0] * outward[0]
            depth = self._within(foot, outward[0], depth)
            there = foot - depth * outward[0]
        return self.settle(there, normal, depth, reach=self.step)

    def advance(self, point, normal, heading, *, depth, rng):
        """Take one step; turn by increasing angles until a step succeeds."""
        for attempt in range(_TRIES):
            along = heading - (heading @ normal) * normal
            length = np.linalg.norm(along)
            if length > 1e-6:
                heading = along / length
                state = self._step(point, normal, heading, depth=depth)
                if state is not None:
                    return state, heading
            heading = heading + rng.normal(0, 0.3 * (attempt + 1), 3)
        return None, None


def _spiral(engine, count):
    """Return a path of six turns around a sphere, at depths of 2 to 5 % of its radius."""
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


def _depths(count, shallow, deep, *, rng):
    """Return depths that vary smoothly between ``shallow`` and ``deep``."""
    time = np.arange(count) / max(count - 1, 1)
    wave = sum(
        np.sin(2 * np.pi * (cycles * time + rng.random())) / cycles**0.5 for cycles in (3, 7, 13)
    )
    share = (wave - wave.min()) / np.ptp(wave)
    return shallow + (deep - shallow) * share

"""Tests robustness: long runs, other units, rounded positions, special points, NaN."""

import itertools

import numpy as np

from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.judge.stress.probes import excess
from pandis.pipeline.kinds.field import OK

#: Number of points per query of a long run. The first CHUNK points are queried again at its end.
CHUNK = 50_000
#: Distance that the probe moves per tick of a long run (unit frame): 1 m/s on an object of 0.1 m.
PACE = 0.018
#: Factors on the mesh's units, and offsets in multiples of its longest side.
SCALES, OFFSETS = (1e-6, 1e-3, 1e3, 1e6), (1e3, 1e6)
#: A change of units or position may change distances by up to SAME (unit frame). Forces may change
#: by more only on the share ELSEWHERE of the area, where two walls are almost equally near.
SAME, ELSEWHERE = 1e-7, 0.005
#: Coordinates that are not finite, or outside of any workspace.
_NOWHERE = (np.nan, np.inf, -np.inf, 1e300, -1e300)
#: When points are rounded to float32, the force may change by up to this times k times the largest
#: rounding. It may change by more only on the share ELSEWHERE of the area.
STEEP = 5.0


def walk(count, rng):
    """Yield a random walk in the box in parts: up to CHUNK points (n, 3), one per tick."""
    place = np.zeros(3)
    for start in range(0, count, CHUNK):
        steps = rng.normal(size=(min(CHUNK, count - start), 3)) * PACE / np.sqrt(3)
        path = place + np.cumsum(steps, axis=0)
        path = 1 - np.abs((path + 1) % 4 - 2)  # reflected at the faces
        yield path
        place = path[-1]


def endurance(answer, count, rng, *, report):
    """Query a random walk of ``count`` ticks, and its first points again at the end.

    Returns
    -------
    dict
        ``ticks``; ``bad``: number of answers with a distance that is not finite or a normal that is
        not of unit length; ``drift``: number of repeated points whose answers differ; ``passed``.
    """
    bad, first, done = 0, None, 0
    for points in walk(count, rng):
        distance, normal = answer(points)
        bad += _bad(distance, normal)
        first = first or (points, distance, normal)
        done += len(points)
        report.update(done)
    points, *before = first
    changed = np.zeros(len(points), bool)
    for old, new in zip(before, answer(points), strict=True):
        changed |= (old != new).reshape(len(points), -1).any(axis=1)
    drift = int(changed.sum())
    return {"ticks": count, "bad": bad, "drift": drift, "passed": bad == 0 and drift == 0}


def _bad(distance, normal):
    """Count answers with a distance that is not finite or a normal that is not of unit length."""
    off = np.abs(np.linalg.norm(normal, axis=1) - 1)
    return int((~np.isfinite(distance) | ~(off < 1e-5)).sum())


def invariance(field, shell):
    """Query a field in other units and far from the origin.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    shell : pandis.pipeline.judge.stress.probes.Shell

    Returns
    -------
    dict
        ``distance``: the largest difference of distances (unit frame); ``changed``: the share of
        the area where forces differ by more than ``limit``; ``passed``.
    """
    frame, points = field.frame, shell.points
    wanted_distance, wanted_normal = field.answer(points)
    expected = penalty_force(wanted_distance, wanted_normal)
    length, off, changed = UNIT_SIDE / frame.scale, 0.0, 0.0
    cases = [(f, 0.0) for f in SCALES] + [(1.0, o) for o in OFFSETS]
    for factor, offset in cases:
        move = np.array([1.0, -0.5, 0.25]) * offset * length
        there = factor * (frame.to_mesh(points) + move)
        distance, normal = field.placed(factor, move).distance_and_normal(there)
        distance = distance * frame.scale / factor
        off = max(off, float(np.abs(distance - wanted_distance).max()))
        change = np.linalg.norm(penalty_force(distance, normal) - expected, axis=1)
        changed = max(changed, float(shell.weight[~(change <= SAME)].sum()))
    passed = off <= SAME and changed <= ELSEWHERE
    return {"distance": off, "changed": changed, "limit": SAME, "passed": passed}


def precision(answer, exact, shell, *, scale):
    """Measure how the force changes if points are rounded to float32, as host programs may do.

    Returns
    -------
    dict
        ``changed``: the share of the area where the force changes by more than STEEP times k times
        the largest rounding, and by more than 1.1 times the change of the exact force; ``newtons``:
        the largest change; ``limit``, ``passed``.
    """
    points = shell.points
    rounded = points.astype(np.float32).astype(np.float64)
    change, reference = (
        np.linalg.norm(np.subtract(*(penalty_force(*a(p)) for p in (points, rounded))), axis=1)
        for a in (answer, exact)
    )
    flat = STEEP * np.linalg.norm(points - rounded, axis=1).max()
    # allow for fields that compute in float32: they round relative to their values
    changed = excess(change, reference, max(flat, 2**-18), weight=shell.weight)
    return {
        "changed": changed,
        "newtons": float(change.max() * scale.newtons),
        "limit": ELSEWHERE,
        "passed": changed <= ELSEWHERE,
    }


def special_points(vertices, faces, places, *, thickness):
    """Return points (n, 3), unit frame, at which a field may fail.

    They are vertices, edge midpoints and face centroids of the mesh, points of the medial axis
    below surface points, and the box's corners, edge midpoints, face centres and centre.
    """
    corners = vertices[faces[:: max(1, len(faces) // 1000)]]
    edges = (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3) / 2
    box = np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=3)))
    medial = places.feet - thickness[:, None] * places.outward
    return np.concatenate([corners.reshape(-1, 3), edges, corners.mean(axis=1), medial, box])


def special(field, points):
    """Query a field at special points, and at points that are not finite or are very far away.

    Returns
    -------
    dict
        ``bad``: number of answers with a distance that is not finite or a normal that is not of
        unit length; ``unflagged``: number of points, not finite or very far away, that are not
        flagged or get a force; ``passed``.
    """
    bad = _bad(*field.answer(points))
    lost = [[v if k == axis else 0.1 for k in range(3)] for axis in range(3) for v in _NOWHERE]
    answer = field.query(np.array(lost))
    push = np.nan_to_num(penalty_force(answer.distance, answer.normal)).any(axis=1)
    unflagged = int((push | (answer.flag == OK)).sum())
    return {"bad": bad, "unflagged": unflagged, "passed": bad == 0 and unflagged == 0}

"""Measures how far a field's distances can be trusted to keep a probe out of contact.

A scene queries an object again only when the probe may touch it. A field at distance d cannot be
touched before the probe has moved by d, less the error of d against the exact distance.
"""

import numpy as np

from pandis.pipeline.kinds.field import BOUND, OK

#: Number of points drawn in the box, and again just outside the surface.
POINTS = 60_000
#: Range of the heights of points just outside the surface (unit frame), log-uniform.
HEIGHTS = 1e-4, 0.5
#: Excesses are multiplied by MORE, and ROUNDING is added, because sampling can miss the worst case.
MORE, ROUNDING = 1.5, 1e-9
#: The measured height is multiplied by LESS. _FARTHEST exceeds every distance to a surface in the
#: box.
LESS, _FARTHEST = 0.98, 4.0
#: Search for worse points near the worst ones: starts, rounds, tries per start and round, initial
#: spread of the tries (unit frame), and factor on the spread per round.
_STARTS, _ROUNDS, _TRIES, _FAR, _NEARER = 64, 10, 12, 0.03, 0.6


def clearance(answer, engine, seed=0):
    """Measure where a field can have contacts, and the error of its distance in free space.

    Parameters
    ----------
    answer : callable
        The field. Returns distances (n,) and flags (n,) at points (n, 3), unit frame.
    engine : pandis.pipeline.geometry.distance.MeshDistance or ShapeDistance

    Returns
    -------
    ndarray, shape (9,)
        Lowest and highest corner of the surface's box, two margins, and a height (unit frame). No
        contact lies farther outside the surface than the first margin. No contact is nearer to a
        point than the point's distance less the first margin, or less the second where the distance
        is flagged as a bound. A point of the box whose distance is positive and flagged as a bound
        is at least that height away from the surface. The margins and the height are not proved.
        They are measured with a safety factor, at sampled points and in a search near the worst of
        them.
    """
    rng = np.random.default_rng(seed)
    box = rng.uniform(-1, 1, (POINTS, 3))
    far, direction = engine.distance_and_normal(box, check=False)
    height = np.exp(rng.uniform(*np.log(HEIGHTS), POINTS))
    near = box + (height - far)[:, None] * direction
    near = near[(np.abs(near) <= 1).all(axis=1)]
    exact = np.concatenate([far, engine.distance_and_normal(near, check=False)[0]])
    distance, flag = answer(np.concatenate([box, near]))
    every = np.concatenate([box, near])

    def measure(points, known=None):
        """Return three excesses for the margins, and the nearness of bounds, at points: (n, 4)."""
        exact, distance, flag = known or (
            engine.distance_and_normal(points, check=False)[0],
            *answer(points),
        )
        free = (exact > 0) & np.isfinite(distance)
        off = [np.where(free & (flag == kind), distance - exact, 0.0) for kind in (OK, BOUND)]
        bound = free & (flag == BOUND) & (distance > 0)
        near = np.where(bound, _FARTHEST - exact, 0.0)
        return np.column_stack([np.where(free & (distance < 0), exact, 0.0), *off, near])

    excess = measure(every, (exact, distance, flag))
    ghost, *over, near = (_worst(measure, every, column, index=index, rng=rng)
                          for index, column in enumerate(excess.T))  # fmt: skip
    margins = (MORE * (ghost + most) + ROUNDING for most in over)
    return np.array([*engine.bounds.ravel(), *margins, LESS * (_FARTHEST - near)])


def _worst(measure, points, excess, *, index, rng):
    """Return the largest excess of one margin, at the points or near the worst of them."""
    first = np.argsort(-excess, kind="stable")[:_STARTS]
    if not excess[first[0]] > 0:
        return 0.0
    best, value, reach = points[first], excess[first], _FAR
    for _ in range(_ROUNDS):
        tries = best[:, None] + rng.normal(0, reach, (len(best), _TRIES, 3))
        tries = np.clip(tries, -1, 1)
        reached = measure(tries.reshape(-1, 3))[:, index].reshape(len(best), _TRIES)
        pick = reached.argmax(axis=1)
        each = np.arange(len(best))
        better = reached[each, pick] > value
        best = np.where(better[:, None], tries[each, pick], best)
        value = np.where(better, reached[each, pick], value)
        reach *= _NEARER
    return float(value.max())

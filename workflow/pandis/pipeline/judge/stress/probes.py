"""Points at which fields are tested; none is deeper than a probe can be pressed there."""

from typing import NamedTuple

import numpy as np

from pandis.base.arrays import Values


class Shell(NamedTuple):
    """Points below a surface, down to the depth of the device's largest force.

    Attributes
    ----------
    points : ndarray, shape (n, 3), unit frame
    weight : ndarray, shape (n,)
        Share of the area that each point represents; the sum is 1.
    """

    points: np.ndarray
    weight: np.ndarray


def shell_points(places, count, deepest, *, rng):
    """Return about ``count`` points at random depths below stratified surface points.

    Parameters
    ----------
    places : pandis.pipeline.geometry.places.Stratified
    count : int
    deepest : float
        Largest depth, unit frame. Where the part is thin, the depth is limited further: see
        `pandis.pipeline.geometry.places.Stratified.depth`.
    rng : numpy.random.Generator
    """
    times = max(1, round(count / len(places.feet)))
    depth = np.tile(places.depth(deepest), times) * rng.random(times * len(places.feet))
    points = np.tile(places.feet, (times, 1)) - depth[:, None] * np.tile(places.outward, (times, 1))
    return Shell(points, np.tile(places.weight, times) / times)


def directions(count, rng):
    """Draw unit vectors (n, 3), uniform over all directions."""
    along = rng.normal(size=(count, 3))
    return along / np.linalg.norm(along, axis=1, keepdims=True)


def excess(value: Values, reference: Values, floor, *, weight: Values, more=1.1):
    """Return the share of the area where a value exceeds both a floor and the exact field's.

    Parameters
    ----------
    value, reference : ndarray, shape (n,)
        Values of a field and of the exact one, at the same points.
    floor : float
    weight : ndarray, shape (n,)
        Share of the area that each point represents.
    more : float
        Multiple of the exact field's value that a field may reach.
    """
    # the comparison is negated so that NaN counts as above
    return float(weight[~(value <= np.maximum(floor, more * reference))].sum())

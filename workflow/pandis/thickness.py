"""How thick a solid is below points of its surface."""

import numpy as np

from pandis.frame import UNIT_SIDE

_HALVINGS = 40
_SAME = 1e-6


def inscribed_radius(engine, points, normals, halvings=_HALVINGS):
    """Return the radius (n,) of the largest ball inside that touches each surface point.

    From there on another wall is nearer: half the thickness of a plate, and the depth at which
    a penalty force turns over. By halving: the point in question is the nearest, or no longer.

    Parameters
    ----------
    engine : object
        From `pandis.distance.open_distance`.
    points, normals : ndarray, shape (n, 3), unit frame
        On the surface, outward.
    halvings : int
        Each adds a binary digit.
    """
    low, high = np.zeros(len(points)), np.full(len(points), UNIT_SIDE / 2)
    for _ in range(halvings):
        middle = (low + high) / 2
        distance = engine.distance_and_normal(points - middle[:, None] * normals)[0]
        own = np.abs(distance + middle) < _SAME
        low, high = np.where(own, middle, low), np.where(own, high, middle)
    return low

"""How thick a solid is below points of its surface."""

import numpy as np

from pandis.geometry.arrays import Points, Values
from pandis.geometry.frame import UNIT_SIDE

#: A ball touches its own point if the surface is no nearer to its centre than this (unit frame).
_SAME = 1e-6
#: Steps of a shrinking ball; each brings it to the nearest point of the surface seen so far.
_STEPS = 60


def inscribed_radius(engine, points: Points, normals: Points, largest=UNIT_SIDE / 2) -> Values:
    """Return the radius (n,) of the largest ball inside that touches each surface point.

    From there on another wall is nearer: half the thickness of a plate, and the depth at which
    a penalty force turns over. By shrinking balls (Ma, Bae and Choi 2012): the ball through the
    surface point that touches the point nearest to its centre, until none is nearer. The radius
    falls at every step, so that what is returned is never less than the true one by more than
    rounding.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.geometry.body.Body`.
    points, normals : ndarray, shape (n, 3), unit frame
        On the surface, outward.
    largest : float
        No more is answered: what lies deeper is not looked at, and need not be for most purposes.
    """
    radius = np.full(len(points), float(largest))
    open_ = np.arange(len(points))
    for _ in range(_STEPS):
        here, outward, size = points[open_], normals[open_], radius[open_]
        centre = here - size[:, None] * outward
        distance, direction = engine.distance_and_normal(centre, check=False)
        smaller = np.abs(distance + size) >= _SAME
        open_, here, outward = open_[smaller], here[smaller], outward[smaller]
        if not len(open_):
            break
        foot = centre[smaller] - distance[smaller, None] * direction[smaller]
        way = here - foot
        along = np.einsum("ij,ij->i", way, outward)
        square = np.einsum("ij,ij->i", way, way)
        with np.errstate(divide="ignore", invalid="ignore"):
            shrunk = np.where(along > 0, square / (2 * along), 0.0)
        # the ball through the nearest point; halved where rounding would keep it as it is
        radius[open_] = np.where(shrunk < size[smaller], shrunk, size[smaller] / 2)
    return radius

"""How thick a solid is below points of its surface."""

import numpy as np

from pandis.base.arrays import Flags, Points, Values
from pandis.base.frame import UNIT_SIDE

#: A ball touches its own point if the surface is no nearer to its centre than this (unit frame).
_SAME = 1e-6
#: Steps of a shrinking ball; each brings it to the nearest point of the surface seen so far.
_STEPS = 60
#: Below a wall the matter is at most this many inscribed radii thick: two under a plate, three in
#: the middle of a triangular bar, four where two faces meet at 70°.
WALL = 4.0


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
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
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


def are_walls(engine, points: Points, normals: Points, radius: Values) -> Flags:
    """Tell which surface points (n,) lie on a wall: where the matter below is thin.

    A small ball inside says that another face is near, not that it lies opposite: next to a convex
    edge of thick matter the radius tends to 0 as well. So the way straight in is measured: it
    leaves a wall within `WALL` radii. All places whose ball touches faces with normals more than
    120° apart are walls, and so is the middle of a thin bar's sides, where they are 90° apart.

    Parameters
    ----------
    engine, points, normals
        As for `inscribed_radius`.
    radius : ndarray, shape (n,)
        What `inscribed_radius` returns.
    """
    wall = np.zeros(len(points), bool)
    inside = np.arange(len(points))
    way = 2 * radius  # so far it leads through the ball
    for _ in range(_STEPS):
        there = points[inside] - way[inside, None] * normals[inside]
        distance = engine.distance_and_normal(there, check=False)[0]
        out = distance >= -2 * _SAME
        wall[inside[out]] = True
        way[inside] -= np.minimum(distance, 0.0)
        inside = inside[~out & (way[inside] < WALL * radius[inside])]
        if not len(inside):
            break
    return wall

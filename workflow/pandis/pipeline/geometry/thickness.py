"""Thickness of a solid below points on its surface."""

import numpy as np

from pandis.base.arrays import Flags, Points, Values
from pandis.base.frame import UNIT_SIDE

#: Tolerance (unit frame) for an inscribed ball; twice this for having left the solid.
_SAME = 1e-6
#: Limit on the steps of a shrinking ball, and on those of the path straight in.
_STEPS = 60
#: Below a wall the solid is at most this many inscribed radii thick: two in a plate, three in the
#: middle of a triangular bar, four where two faces meet at 70°.
WALL = 4.0


def inscribed_radius(engine, points: Points, normals: Points, largest=UNIT_SIDE / 2) -> Values:
    """Return the radius (n,) of the largest inscribed ball that touches each surface point.

    At greater depths another wall is nearer, and a penalty force reverses. For a plate it is half
    the thickness. Shrinking balls (Ma, Bae and Choi 2012): a ball through the surface point is
    replaced by one that also touches the point nearest to its centre, until none is nearer. The
    radius falls at every step, so the result is smaller than the true radius only by rounding.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    points, normals : ndarray, shape (n, 3), unit frame
        On the surface, outward.
    largest : float
        Upper limit of the result: nothing deeper is examined, and most callers need no more.
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
        # the ball through the nearest point; halved where rounding would leave it unchanged
        radius[open_] = np.where(shrunk < size[smaller], shrunk, size[smaller] / 2)
    return radius


def are_walls(engine, points: Points, normals: Points, radius: Values) -> Flags:
    """Return which surface points (n,) are on a wall, where the solid below is thin.

    A small inscribed ball means that another face is near, but not that it is opposite: next to a
    convex edge of a thick part the radius tends to 0, too. So the path straight in is measured. It
    leaves a wall within `WALL` radii. All places whose ball touches faces with normals more than
    120° apart are walls. So is the middle of a thin bar's sides, where they are 90° apart.

    Parameters
    ----------
    engine, points, normals
        As for `inscribed_radius`.
    radius : ndarray, shape (n,)
        From `inscribed_radius`.
    """
    wall = np.zeros(len(points), bool)
    inside = np.arange(len(points))
    way = 2 * radius  # up to here it is inside the ball
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

"""Measures the thickness of a solid below points on its surface."""

import numpy as np

from pandis.base.arrays import Flags, Points, Values
from pandis.base.frame import UNIT_SIDE

#: Tolerance (unit frame) of an inscribed ball's radius. A path has left the solid once its depth is
#: at most twice this.
_SAME = 1e-6
#: Maximum number of steps of a shrinking ball, and of a path straight inward.
_STEPS = 60
#: Largest thickness of a wall, in inscribed radii. The thickness is two radii in a plate, three in
#: the middle of a triangular bar, and four where two faces meet at 70°.
WALL = 4.0


def inscribed_radius(engine, points: Points, normals: Points, *, largest=UNIT_SIDE / 2) -> Values:
    """For each surface point, return the radius (n,) of the largest inscribed ball touching it.

    Deeper than this, another face is nearer, and a penalty force reverses. For a plate the radius
    is half the thickness. The method is that of shrinking balls (Ma, Bae and Choi 2012): a ball is
    replaced by one that also touches the surface point nearest to its centre, until no surface
    point is nearer than the given one. The radius falls at every step, so only rounding can make
    the result smaller than the true radius.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    points, normals : ndarray, shape (n, 3), unit frame
        Points on the surface, and outward unit normals.
    largest : float or ndarray, shape (n,)
        Upper limit of the radius (unit frame), or of each; nothing deeper is examined.
    """
    radius = np.array(np.broadcast_to(largest, len(points)), np.float64)
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
        # use the ball through the nearest point; halve it where rounding leaves it unchanged
        radius[open_] = np.where(shrunk < size[smaller], shrunk, size[smaller] / 2)
    return radius


def are_walls(engine, points: Points, normals: Points, *, radius: Values) -> Flags:
    """Return a mask (n,) of the surface points on walls, where the solid below is thin.

    A small inscribed ball alone does not show a wall: near a convex edge of a thick part, the
    radius also tends to 0, although no face is opposite. So the path straight inward is measured: a
    point is on a wall if this path leaves the solid within `WALL` radii. This holds for all points
    whose ball touches faces with normals more than 120° apart. It also holds for the middles of a
    thin bar's sides, where normals are 90° apart.

    Parameters
    ----------
    engine, points, normals
        As for `inscribed_radius`.
    radius : ndarray, shape (n,)
        From `inscribed_radius`.
    """
    wall = np.zeros(len(points), bool)
    inside = np.arange(len(points))
    way = 2 * radius  # the path is inside the ball up to here
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

"""Draws surface points to press on: the same number from each class of thickness."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pandis.pipeline.geometry.measure import OF_RADIUS, too_thin
from pandis.pipeline.geometry.shares import JUDGED
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius

#: Bounds of the classes of inscribed radius, as cumulative shares of area. The thinnest 0.5 % of
#: the surface gets as many stratified points as the thickest 60 %.
_CLASSES = (0.0, 0.005, 0.02, 0.1, 0.4, 1.0)
#: Upper limit of inscribed radii (unit frame): enough for 4 N on a 10 cm object at 400 N/m.
THICKEST = 0.2
#: Number of candidates from which stratified points are chosen.
_POOL = 20_000


class Stratified(NamedTuple):
    """Surface points, in equal numbers from each class of inscribed radius.

    Attributes
    ----------
    feet, outward : ndarray, shape (n, 3)
        Points on the surface, and the unit normals there; unit frame.
    radius : ndarray, shape (n,)
        Inscribed radii, at most `THICKEST`.
    weight : ndarray, shape (n,)
        Share of the sampled area that each point represents; they sum to 1.
    wall : ndarray, shape (n,)
        Whether each point is on a wall.
    """

    feet: np.ndarray
    outward: np.ndarray
    radius: np.ndarray
    weight: np.ndarray
    wall: np.ndarray

    def depth(self, deepest):
        """Return each press's depth (n,): 0.9 of the inscribed radius, at most ``deepest``."""
        return np.minimum(OF_RADIUS * self.radius, deepest)


def stratify(body, scale, count, *, rng, among="pushing"):
    """Draw surface points from each class of inscribed radius, so that no thin part is missed.

    Parameters
    ----------
    body, scale, rng
        As for `draw_contacts`.
    count : int
        Approximate number of points; rounded down to a multiple of the number of classes.
    among : {"pushing", "judged", "all"}
        ``pushing``: the area where a press to 0.9 of the inscribed radius produces at least 0.05 N,
        so that a penalty force can resist a hand. ``judged``: also thin walls. ``all``: all area,
        because with a proxy a hand can press anywhere. Walls too thin to be judged are always left
        out.

    Returns
    -------
    Stratified
        If there is no such area, the points are from the thickest hundredth of all candidates.
    """
    feet, outward, _, _ = body.surface.draw(_POOL, rng)
    radius = inscribed_radius(body.distance, feet, outward, largest=THICKEST)
    wall = are_walls(body.distance, feet, outward, radius=radius)
    pushing = OF_RADIUS * radius * scale.newtons >= JUDGED
    drawn = {"pushing": pushing, "judged": pushing | wall, "all": np.ones(len(feet), bool)}[among]
    chosen = np.flatnonzero(drawn & ~too_thin(radius, wall, scale))
    if not len(chosen):
        chosen = np.argsort(radius, kind="stable")[-max(_POOL // 100, 1) :]
    order = chosen[np.argsort(radius[chosen], kind="stable")]
    each, picks, weights = max(count // (len(_CLASSES) - 1), 1), [], []
    for low, high in pairwise(_CLASSES):
        members = order[round(low * len(order)) : round(high * len(order))]
        if len(members):
            pick = members[np.unique(np.linspace(0, len(members) - 1, each).astype(int))]
            picks.append(pick)
            weights.append(np.full(len(pick), (high - low) / len(pick)))
    pick, weight = np.concatenate(picks), np.concatenate(weights)
    return Stratified(feet[pick], outward[pick], radius[pick], weight / weight.sum(), wall[pick])

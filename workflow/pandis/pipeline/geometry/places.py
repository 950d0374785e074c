"""Surface points of which every thickness has as many: where devices and hands press."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pandis.pipeline.geometry.measure import OF_RADIUS, too_thin
from pandis.pipeline.geometry.shares import JUDGED
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius

#: Bounds, by share of area, of the classes of inscribed radius that stratified points are drawn
#: from: the thinnest half of a percent has as many points as the thick half of the surface.
_CLASSES = (0.0, 0.005, 0.02, 0.1, 0.4, 1.0)
#: Radii are told apart up to this (unit frame): a press of 4 N on an object of 10 cm at 400 N/m.
THICKEST = 0.2
#: Candidates that stratified points are picked from.
_POOL = 20_000


class Stratified(NamedTuple):
    """Surface points of which every class of inscribed radius has as many.

    Attributes
    ----------
    feet, outward : ndarray, shape (n, 3)
        On the surface, and the unit normals there; unit frame.
    radius : ndarray, shape (n,)
        Inscribed radii, up to `THICKEST`.
    weight : ndarray, shape (n,)
        Share of the area drawn from that each stands for; they sum to 1.
    wall : ndarray, shape (n,)
        Which of them are walls.
    """

    feet: np.ndarray
    outward: np.ndarray
    radius: np.ndarray
    weight: np.ndarray
    wall: np.ndarray

    def depth(self, deepest):
        """Return how deep (n,) a probe presses there: 0.9 r, or ``deepest`` if that is less."""
        return np.minimum(OF_RADIUS * self.radius, deepest)


def stratify(surface, engine, scale, count, rng, among="pushing"):
    """Draw surface points by classes of inscribed radius, so that no thin part is left out.

    Parameters
    ----------
    surface, engine, scale, rng
        As for `draw_contacts`.
    count : int
        About how many; a multiple of the number of classes.
    among : {"pushing", "judged", "all"}
        Draw from the area where a press to 0.9 of the inscribed radius makes 0.05 N or more, so
        that a penalty force can hold a hand; from all that is judged, thin walls, too; or from all
        area but walls too thin to be judged: through a proxy a hand presses anywhere.

    Returns
    -------
    Stratified
        Where there is nothing to draw from, of the thickest hundredth: something has to be pressed.
    """
    feet, outward, _, _ = surface.draw(_POOL, rng)
    radius = inscribed_radius(engine, feet, outward, THICKEST)
    wall = are_walls(engine, feet, outward, radius)
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

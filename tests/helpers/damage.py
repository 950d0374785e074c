"""Damaged versions of an exact field: what a verdict must notice.

Each is right almost everywhere, and wrong as fields are wrong in practice: in one place, behind a
smooth border, on the thin parts alone, or everywhere by a little. What is changed goes by the foot
of a query, the closest point of the surface, so that all depths below a place are changed alike.
"""

from typing import NamedTuple

import numpy as np

from pandis.pipeline.geometry.places import THICKEST
from pandis.pipeline.geometry.thickness import inscribed_radius
from pandis.pipeline.kinds.field import ExactField, Field, normalise

#: Surface points that shares of area are counted on.
POOL = 20_000
#: Where patches lie, as shares of the way along those points, and how wide their borders are, as
#: shares of their radius.
PLACES = (0.13, 0.25), (0.47, 0.5), (0.83, 1.0)
#: Newtons that verdicts once did not judge: walls too thin to push back so much.
UNFELT = 0.05
#: Radius (m) and largest force (N) of a ball of force in free space; its gap to the surface (m).
GHOST, GHOST_FORCE, GAPS = 2.8e-3, 11.0, (5e-4, 5e-3)
#: Radii that differ by less (unit frame) are the same: among them the place decides.
_SAME_RADIUS = 1e-5
#: No surface is parallel to it by accident.
_OBLIQUE = np.array([0.36, 0.48, 0.8])


class Damaged(Field):
    """An exact field with something changed.

    Parameters
    ----------
    name : str
    exact : pandis.pipeline.kinds.exact.reference.ExactField
    change : callable
        Returns distance (n,) and normal (n, 3) for points (n, 3), their feet, and what is exact.
    """

    def __init__(self, name, exact, change):
        super().__init__(name, exact.frame, exact.bytes)
        self.exact, self.change = exact, change

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        distance, normal = self.exact.answer(points)
        return self.change(points, points - distance[:, None] * normal, distance, normal)


class Patch(NamedTuple):
    """Balls in which the surface is wrong.

    Attributes
    ----------
    centres : ndarray, shape (m, 3)
    radius : ndarray, shape (m,)
    border : float
        Width of the border, as a share of the radius; 0: it ends at once.
    across : ndarray, shape (3,)
        A direction along the surface: towards it normals are tilted.
    """

    centres: np.ndarray
    radius: np.ndarray
    border: float
    across: np.ndarray

    def __call__(self, feet):
        """Return 1 for those of some feet (n, 3) that lie inside, 0 outside, C1 in between."""
        apart = np.linalg.norm(feet[:, None] - self.centres, axis=2)
        beyond = (apart - self.radius) / np.maximum(self.border * self.radius, 1e-12)
        return smooth(1 - np.nan_to_num(beyond, nan=1.0)).max(axis=1)


EVERYWHERE = Patch(np.zeros((1, 3)), np.full(1, 9.0), 0.0, _OBLIQUE)


def smooth(share):
    """Return a C1 ramp from 0 to 1."""
    share = np.clip(share, 0, 1)
    return share**2 * (3 - 2 * share)


def tilted(degrees, patch, deeper=None):
    """Turn normals, below a depth alone if one is given."""

    def change(points, feet, distance, normal):
        turn = np.radians(degrees) * patch(feet)
        if deeper is not None:
            turn = turn * smooth(np.nan_to_num(-distance) / deeper - 1)
        side = normalise(patch.across - (normal @ patch.across)[:, None] * normal)
        return distance, np.cos(turn)[:, None] * normal + np.sin(turn)[:, None] * side

    return change


def scaled(factor, patch):
    """Multiply depths, and so forces; with 0 there are none."""

    def change(points, feet, distance, normal):
        share = 1 + (factor - 1) * patch(feet)
        return np.where(distance < 0, share * distance, distance), normal

    return change


def moved(outward, patch):
    """Move the surface out by a length (in, if negative), with the normals that it has then."""

    def change(points, feet, distance, normal):
        steps = 1e-5 * np.eye(3)
        slope = np.stack([patch(feet + step) - patch(feet - step) for step in steps], axis=1) / 2e-5
        slope -= np.einsum("ij,ij->i", slope, normal)[:, None] * normal
        return distance - outward * patch(feet), normalise(normal - outward * slope)

    return change


def flipped(patch):
    """Take inside for outside, and outside for inside."""

    def change(points, feet, distance, normal):
        sign = np.where(patch(feet) > 0.5, -1.0, 1.0)
        return sign * distance, sign[:, None] * normal

    return change


def zeroed(thin):
    """Leave no force where ``thin`` says so of feet and outward normals."""

    def change(points, feet, distance, normal):
        inside = np.flatnonzero(distance < 0)
        distance = distance.copy()
        distance[inside[thin(feet[inside], normal[inside])]] = 0.0
        return distance, normal

    return change


def haunted(centre, radius, depth):
    """Put a ball of force into free space, so deep in its middle."""

    def change(points, feet, distance, normal):
        apart = np.linalg.norm(points - centre, axis=1)
        within = apart < radius
        distance = np.where(within, -depth * smooth(1 - apart / radius), distance)
        return distance, np.where(within[:, None], normalise(points - centre), normal)

    return change


def damages(body, surface, scale):
    """Return damaged versions of the exact field of a body.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    surface : pandis.pipeline.geometry.sampling.Surface
    scale : pandis.base.physical.Scale

    Returns
    -------
    dict of str to Damaged
        By what is wrong. Walls too thin to be felt are left out where they are no part of a body,
        ghosts where it has no room for them.
    """
    exact, made = ExactField("exact", body), {}
    feet, outward, _, _ = surface.draw(POOL, np.random.default_rng(0))
    radius = inscribed_radius(exact.engine, feet, outward, largest=THICKEST)

    def patch(share, place=0.29, border=0.5, count=1):
        seeds = ((place + np.arange(count) / count) % 1 * POOL).astype(int)
        apart = np.linalg.norm(feet[:, None] - feet[seeds], axis=2)
        size = np.sort(apart, axis=0)[int(share / count * POOL)]
        return Patch(feet[seeds], size, border, np.cross(outward[seeds[0]], _OBLIQUE))

    for number, at in enumerate(PLACES, 1):
        for degrees, share in ((59, 0.02), (45, 0.05), (30, 0.10)):
            made[f"tilt-{degrees}-on-{share:.0%}-{number}"] = tilted(degrees, patch(share, *at))
        made[f"weak-0.55-on-15%-{number}"] = scaled(0.55, patch(0.15, *at))
        made[f"dent-0.7mm-on-3%-{number}"] = moved(-7e-4 * scale.metre, patch(0.03, *at))
    half = np.median(radius) / 4  # from there on, and wholly from half of the radius
    made |= {
        "hard-tilt-59-on-2%": tilted(59, patch(0.02, 0.13, 0.0)),
        "hard-tilt-45-on-5%": tilted(45, patch(0.05, 0.13, 0.0)),
        "weak-0.6-everywhere": scaled(0.6, EVERYWHERE),
        "strong-1.9-everywhere": scaled(1.9, EVERYWHERE),
        "tilt-45-everywhere": tilted(45, EVERYWHERE),
        "out-0.25mm-everywhere": moved(2.5e-4 * scale.metre, EVERYWHERE),
        "flip-0.5%": flipped(patch(0.005, 0.61, 0.0)),
        "zero-1%": scaled(0.0, patch(0.01, 0.61)),
        "weak-0.3-one-patch-of-2%": scaled(0.3, patch(0.02)),
        "weak-0.3-eight-patches-of-2%": scaled(0.3, patch(0.02, count=8)),
        "tilt-59-eight-patches-of-2%": tilted(59, patch(0.02, count=8)),
        "tilt-45-deep-only-on-10%": tilted(45, patch(0.1), deeper=half),
    }

    def thinness(feet, outward):
        # a plate is equally thin everywhere: the nearest to one place is taken to be the thinnest
        own = inscribed_radius(exact.engine, feet, outward, largest=THICKEST)
        return np.rint(own / _SAME_RADIUS) + np.linalg.norm(feet - seed, axis=1) / 4

    seed, least = feet[POOL // 3], UNFELT / scale.newtons / 0.9
    last = np.sort(thinness(feet, outward))[POOL // 50]
    made["zero-thinnest-2%"] = zeroed(lambda *places: thinness(*places) < last)
    if (radius < least).mean() > 0.05:  # more than the strips along edges
        made["zero-unfelt-walls"] = zeroed(lambda *at: thinness(*at) * _SAME_RADIUS < least)
    made |= _ghosts(exact, feet, outward, scale)
    return {name: Damaged(name, exact, change) for name, change in made.items()}


def _ghosts(exact, feet, outward, scale):
    """Return balls of force: two next to the surface at each gap, and two far from it."""
    made, radius, depth = {}, GHOST * scale.metre, GHOST_FORCE / scale.newtons
    for gap in GAPS:
        away = gap * scale.metre + radius
        for number, place in enumerate((0.2, 0.7), 1):
            some = (int(place * POOL) + np.arange(POOL // 10)) % POOL
            centres = feet[some] + away * outward[some]
            # where nothing is nearer than the point that the ball was laid on
            room = centres[exact.answer(centres)[0] > 0.95 * away]
            if len(room):
                made[f"ghost-{1e3 * gap:g}mm-off-{number}"] = haunted(room[0], radius, depth)
    box = np.random.default_rng(1).uniform(-0.95, 0.95, (2000, 3))
    far = box[np.argsort(exact.answer(box)[0])]
    for number, centre in enumerate((far[-1], far[-500]), 1):
        if exact.answer(centre[None])[0][0] > 2 * radius:
            made[f"ghost-far-{number}"] = haunted(centre, radius, depth)
    return made

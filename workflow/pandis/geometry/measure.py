"""The measure of force error: points that a probe can reach, and how much surface is missing.

A probe pressed onto a wall thinner than twice its depth comes out on the other side, where every
field is right. So points lie no deeper below the surface than nine tenths of the largest ball
inside that touches it there, however thin the part. And because a mean hides a field that is wrong
in one place, the share of the surface is counted on which the force is *missing*, and on which the
difference can be *felt*.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pandis.forces import penalty_force
from pandis.geometry.arrays import Flags, Points, Values
from pandis.geometry.sampling import PROBE_DEPTHS, blue_noise
from pandis.geometry.thickness import inscribed_radius

#: Points lie no deeper than this share of the inscribed radius: short of where the force turns.
OF_RADIUS = 0.9
#: Where that is less than this (m, in the device's workspace), the surface is left out.
THINNEST = 2e-5
#: Where the exact force is less than this (N), or a field's falls short of it by less, nothing is
#: judged: a hand would not feel it.
JUDGED = 0.05
#: A force is missing if it pushes back with less than this share of the exact one.
MISSING = 0.5
#: A difference is felt beyond this share of the exact force, or these newtons if that is more, or
#: if the direction is off by more than this (degrees).
FELT_SHARE, FELT_NEWTONS, FELT_ANGLE = 0.1, 0.02, 25.0
#: A field may lack so much of the surface, wherever fields are judged: a share of its area.
MISSING_LIMIT = 0.005
#: What the contact sets are called in tables.
SETS = {f"contact-{name}": depth for name, depth in PROBE_DEPTHS.items()}
#: Bounds, by share of area, of the classes of inscribed radius that stratified points are drawn
#: from: the thinnest half of a percent has as many points as the thick half of the surface.
_CLASSES = (0.0, 0.005, 0.02, 0.1, 0.4, 1.0)
#: Radii are told apart up to this (unit frame): a press of 4 N on an object of 10 cm at 400 N/m.
THICKEST = 0.2
#: Candidates that stratified points are picked from.
_POOL = 20_000


class Probes(NamedTuple):
    """Points with their exact answers, unit frame.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
    distance : ndarray, shape (n,)
    normal : ndarray, shape (n, 3)
    """

    points: np.ndarray
    distance: np.ndarray
    normal: np.ndarray

    @property
    def force(self):
        """The exact force (n, 3) at k = 1."""
        return penalty_force(self.distance, self.normal)


class ContactSet(NamedTuple):
    """Area-uniform points below a surface, as deep as a probe can press there.

    Attributes
    ----------
    sets : dict of str to Probes
        By the names of `SETS`: depths uniform in [0, min(D, 0.9 r)].
    pressed : Probes
        Below the same surface points, at the depth min(0.04, 0.9 r).
    left_out : float
        Share of the area where 0.9 r is less than `THINNEST`.
    newtons : float
        Newtons per force of the unit frame at k = 1.
    """

    sets: dict
    pressed: Probes
    left_out: float
    newtons: float


def draw_contacts(surface, engine, scale, count, rng, even=False):
    """Draw a contact set.

    Parameters
    ----------
    surface : pandis.geometry.sampling.Surface
    engine : object
        The exact distance of a `pandis.geometry.body.Body`.
    scale : pandis.geometry.physical.Scale
    count : int
        Surface points; those left out are not replaced.
    rng : numpy.random.Generator
    even : bool
        Blue noise: no two surface points closer than they must be.

    Returns
    -------
    ContactSet
    """
    drawn = blue_noise(surface, count, rng) if even else surface.draw(count, rng)
    feet, outward = drawn[:2]
    depths = {name: rng.permutation((np.arange(count) + rng.random(count)) / count)
              for name in SETS}  # fmt: skip
    deepest = max(SETS.values())
    reach = OF_RADIUS * inscribed_radius(engine, feet, outward, deepest / OF_RADIUS)
    kept = reach >= THINNEST * scale.metre
    feet, outward, reach = feet[kept], outward[kept], reach[kept]
    sets = {
        name: below(engine, feet, outward, depths[name][kept] * np.minimum(most, reach))
        for name, most in SETS.items()
    }
    full = below(engine, feet, outward, np.minimum(deepest, reach))
    return ContactSet(sets, full, float(1 - kept.mean()), scale.newtons)


def below(engine, feet: Points, outward: Points, depth: Values):
    """Return the `Probes` at depths (n,) below surface points (n, 3)."""
    points = feet - depth[:, None] * outward
    return Probes(points, *engine.distance_and_normal(points, check=False))


def contact_errors(force_at, contacts):
    """Measure a field on a contact set.

    Parameters
    ----------
    force_at : callable
        Answers the force (n, 3) at points (n, 3), k = 1, unit frame.
    contacts : ContactSet

    Returns
    -------
    dict of str to dict
        By the names of `SETS`: ``mean``, ``p99`` and ``max`` of ‖F − F_exact‖ (unit frame),
        ``relative`` (the mean over that of the exact force), ``newtons`` (the mean in newtons),
        and what `shares` counts at the pressed points.
    """
    counted = shares(force_at(contacts.pressed.points), contacts.pressed.force, contacts.newtons)
    table = {}
    for name, probes in contacts.sets.items():
        exact = probes.force
        error = np.linalg.norm(force_at(probes.points) - exact, axis=1)
        if not len(error):  # everything is thinner than a probe can tell: nothing is known
            error = np.array([np.nan])
        mean = float(error.mean())
        table[name] = {
            "mean": mean,
            "p99": float(np.percentile(error, 99)),
            "max": float(error.max()),
            "relative": mean / max(float(np.linalg.norm(exact, axis=1).mean()), 1e-300)
            if len(exact) else np.nan,
            "newtons": mean * contacts.newtons,
        } | counted  # fmt: skip
    return table


def promise(force_at, contacts):
    """Measure a field on the deep contact set, and bound its errors with high probability.

    Parameters
    ----------
    force_at, contacts
        As for `contact_errors`. What is promised must not be measured on the points that a field
        was chosen by.

    Returns
    -------
    figures : dict
        ``mean``, ``p99``, ``missing``: as measured.
    upper : dict
        The same at two standard errors above, so that another draw of points will hardly show
        more.
    """
    probes, pressed = contacts.sets["contact-deep"], contacts.pressed
    error = np.sort(np.linalg.norm(force_at(probes.points) - probes.force, axis=1))
    counted = shares(force_at(pressed.points), pressed.force, contacts.newtons)
    count, gone = len(error), counted["missing"]
    if not count:
        nothing = {"mean": np.nan, "p99": np.nan, "missing": 1.0}
        return nothing, nothing
    rank = 0.99 * count + 2 * np.sqrt(0.99 * 0.01 * count)
    judged = max(counted["judged"] * count, 1.0)
    figures = {
        "mean": float(error.mean()),
        "p99": float(np.percentile(error, 99)),
        "missing": gone,
    }
    upper = {
        "mean": float(error.mean() + 2 * error.std() / np.sqrt(count)),
        "p99": float(error[min(int(np.ceil(rank)), count - 1)]),
        "missing": gone + 2 * np.sqrt(gone * (1 - gone) / judged) + 2 / judged,
    }
    return figures, upper


def missing(force: Points, exact: Points, newtons) -> Flags:
    """Tell where a force is missing (n,): less than half of the exact one, and by 0.05 N.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3), unit frame, k = 1
    newtons : float
        Newtons per force of the unit frame.
    """
    size = np.linalg.norm(exact, axis=1)
    against = np.einsum("ij,ij->i", force, exact) / np.maximum(size, 1e-300)
    # NaN is no force either
    return ~(against >= MISSING * size) & ~(against > size - JUDGED / newtons)


def felt(force: Points, exact: Points, newtons) -> Flags:
    """Tell where a difference of forces can be felt (n,); parameters as for `missing`."""
    size = np.linalg.norm(exact, axis=1)
    off = np.linalg.norm(force - exact, axis=1)
    length = np.linalg.norm(force, axis=1)
    along = np.einsum("ij,ij->i", force, exact)
    turned = ~(along >= np.cos(np.radians(FELT_ANGLE)) * length * size)
    return ~(off <= np.maximum(FELT_SHARE * size, FELT_NEWTONS / newtons)) | turned


def shares(force: Points, exact: Points, newtons, weight: Values | None = None):
    """Count by share of area where a force is missing, and where it feels different.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3), unit frame, k = 1
    newtons : float
        Newtons per force of the unit frame.
    weight : ndarray, shape (n,), optional
        Area that each point stands for; equal if left out.

    Returns
    -------
    dict of str to float
        ``missing`` and ``felt``, of the area judged: where the exact force is at least 0.05 N;
        ``judged``, that area's share. Where nothing is judged all of it counts as missing, so
        that no verdict rests on nothing.
    """
    weight = np.ones(len(exact)) if weight is None else weight
    judged = np.linalg.norm(exact, axis=1) * newtons >= JUDGED
    total = weight[judged].sum()
    figures = {"judged": float(total / weight.sum()) if len(exact) else 0.0}
    for name, tell in (("missing", missing), ("felt", felt)):
        told = tell(force[judged], exact[judged], newtons)
        figures[name] = float(weight[judged][told].sum() / total) if total else 1.0
    return figures


class Stratified(NamedTuple):
    """Surface points of which every class of inscribed radius has as many.

    Attributes
    ----------
    feet, outward : ndarray, shape (n, 3)
        On the surface, and the unit normals there; unit frame.
    radius : ndarray, shape (n,)
        Inscribed radii, up to `THICKEST`.
    weight : ndarray, shape (n,)
        Share of the judged area that each stands for; they sum to 1.
    """

    feet: np.ndarray
    outward: np.ndarray
    radius: np.ndarray
    weight: np.ndarray

    def depth(self, deepest):
        """Return how deep (n,) a probe presses there: 0.9 r, or ``deepest`` if that is less."""
        return np.minimum(OF_RADIUS * self.radius, deepest)


def stratify(surface, engine, scale, count, rng):
    """Draw surface points by classes of inscribed radius, so that no thin part is left out.

    Parameters
    ----------
    surface, engine, scale, rng
        As for `draw_contacts`.
    count : int
        About how many; a multiple of the number of classes.

    Returns
    -------
    Stratified
        Of the area where a press to 0.9 of the inscribed radius makes 0.05 N or more. Where
        there is none, of the thickest hundredth: something has to be pressed.
    """
    feet, outward, _, _ = surface.draw(_POOL, rng)
    radius = inscribed_radius(engine, feet, outward, THICKEST)
    judged = np.flatnonzero(OF_RADIUS * radius * scale.newtons >= JUDGED)
    if not len(judged):
        judged = np.argsort(radius, kind="stable")[-max(_POOL // 100, 1) :]
    order = judged[np.argsort(radius[judged], kind="stable")]
    each, picks, weights = max(count // (len(_CLASSES) - 1), 1), [], []
    for low, high in pairwise(_CLASSES):
        members = order[round(low * len(order)) : round(high * len(order))]
        if len(members):
            pick = members[np.unique(np.linspace(0, len(members) - 1, each).astype(int))]
            picks.append(pick)
            weights.append(np.full(len(pick), (high - low) / len(pick)))
    pick, weight = np.concatenate(picks), np.concatenate(weights)
    return Stratified(feet[pick], outward[pick], radius[pick], weight / weight.sum())

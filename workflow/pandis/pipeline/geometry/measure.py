"""Measures force errors at points that a probe can reach, and how much surface is missing.

A probe pressed deeper than half the thickness of a wall comes out on the other side, where every
field is right. Points are therefore at most nine tenths of the inscribed radius below the surface,
however thin the part. Because a mean error can hide a field that is wrong in one place, two shares
of the surface are also measured: the share where the force is *missing*, and the share where the
difference can be *felt*.
"""

from typing import NamedTuple

import numpy as np

from pandis.base.arrays import Flags, Points, Values
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS, blue_noise
from pandis.pipeline.geometry.shares import THINNEST, Probes, differences, shares
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius

#: Largest depth of a point, as a fraction of the inscribed radius. Beyond 1, the force reverses.
OF_RADIUS = 0.9
#: Largest depths (unit frame) of the contact sets, by name in tables.
SETS = {f"contact-{name}": depth for name, depth in PROBE_DEPTHS.items()}


class ContactSet(NamedTuple):
    """Points below a surface, uniform by area and no deeper than a probe can press there.

    Attributes
    ----------
    sets : dict of str to Probes
        Points by name of the set. Depths are uniform in [0, min(D, 0.9 r)], where D is the value
        of that name in `SETS`, and r is the inscribed radius.
    pressed : Probes
        Points below the same surface points, at a depth of min(0.04, 0.9 r).
    left_out : float
        Share of the area on walls thinner than `pandis.pipeline.geometry.shares.THINNEST`.
    """

    sets: dict
    pressed: Probes
    left_out: float


def draw_contacts(body, scale, count, *, rng, even=False):
    """Draw a contact set.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    scale : pandis.base.physical.Scale
    count : int
        Number of surface points; points on walls that are too thin are left out, not replaced.
    rng : numpy.random.Generator
    even : bool
        Whether to draw surface points as blue noise, which is more evenly spaced.

    Returns
    -------
    ContactSet
    """
    engine, surface = body.distance, body.surface
    drawn = blue_noise(surface, count, rng) if even else surface.draw(count, rng)
    feet, outward = drawn[:2]
    depths = {name: rng.permutation((np.arange(count) + rng.random(count)) / count)
              for name in SETS}  # fmt: skip
    deepest = max(SETS.values())
    radius = inscribed_radius(engine, feet, outward, largest=deepest / OF_RADIUS)
    wall = are_walls(engine, feet, outward, radius=radius)
    thick_enough = ~too_thin(radius, wall, scale)
    feet, outward, wall, reach = (
        feet[thick_enough],
        outward[thick_enough],
        wall[thick_enough],
        OF_RADIUS * radius[thick_enough],
    )

    def probes(depth):
        return below(engine, feet, outward, depth=depth, wall=wall, scale=scale)

    sets = {name: probes(depths[name][thick_enough] * np.minimum(most, reach))
            for name, most in SETS.items()}  # fmt: skip
    return ContactSet(sets, probes(np.minimum(deepest, reach)), float(1 - thick_enough.mean()))


def too_thin(radius: Values, wall: Flags, scale) -> Flags:
    """Return a mask (n,) of the points on walls that are too thin to be judged."""
    return wall & (2 * radius < THINNEST * scale.metre)


def below(engine, feet: Points, outward: Points, *, depth: Values, wall: Flags, scale):
    """Return the `Probes` at depths (n,) below surface points (n, 3)."""
    points = feet - depth[:, None] * outward
    answers = engine.distance_and_normal(points, check=False)
    return Probes(points, *answers, wall, scale, engine)


def contact_errors(force_at, contacts):
    """Measure a field's errors on a contact set.

    Parameters
    ----------
    force_at : callable
        Returns the force (n, 3) at points (n, 3), k = 1, unit frame.
    contacts : ContactSet

    Returns
    -------
    dict of str to dict
        For each name in `SETS`: ``mean``, ``p99`` and ``max`` of ‖F − F_exact‖ (unit frame),
        ``relative`` (the mean divided by the mean exact force), ``newtons`` (the mean in newtons),
        the result of `shares` at the pressed points, and ``strongly_felt`` from `differences` on
        this set.
    """
    counted, table = shares(force_at(contacts.pressed.points), contacts.pressed), {}
    for name, probes in contacts.sets.items():
        exact, force = probes.force, force_at(probes.points)
        error = np.linalg.norm(force - exact, axis=1)
        if not len(error):  # all of the surface is too thin to be judged
            error = np.array([np.nan])
        mean = float(error.mean())
        table[name] = {
            "mean": mean,
            "p99": float(np.percentile(error, 99)),
            "max": float(error.max()),
            "relative": mean / max(float(np.linalg.norm(exact, axis=1).mean()), 1e-300)
            if len(exact) else np.nan,
            "newtons": mean * probes.scale.newtons,
            "strongly_felt": differences(force, probes)["strongly_felt"],
        } | counted  # fmt: skip
    return table


def promise(force_at, contacts):
    """Measure a field on the deep contact set, and bound its errors with high probability.

    Parameters
    ----------
    force_at, contacts
        As for `contact_errors`. For a promise, the points must differ from those on which the field
        was chosen.

    Returns
    -------
    figures : dict
        ``mean``, ``p99`` and ``missing`` as measured; ``left_out``: the share of the area that is
        too thin to be judged.
    upper : dict
        The same figures plus two standard errors (``left_out`` unchanged), which another draw of
        points is unlikely to exceed.
    """
    probes, pressed = contacts.sets["contact-deep"], contacts.pressed
    error = np.sort(np.linalg.norm(force_at(probes.points) - probes.force, axis=1))
    counted = shares(force_at(pressed.points), pressed)
    count, gone = len(error), counted["missing"]
    if not count:
        nothing = {"mean": np.nan, "p99": np.nan, "missing": 1.0, "left_out": 1.0}
        return nothing, nothing
    rank = 0.99 * count + 2 * np.sqrt(0.99 * 0.01 * count)
    judged = max(counted["judged"] * count, 1.0)
    figures = {
        "mean": float(error.mean()),
        "p99": float(np.percentile(error, 99)),
        "missing": gone,
        "left_out": contacts.left_out,
    }
    upper = {
        "mean": float(error.mean() + 2 * error.std() / np.sqrt(count)),
        "p99": float(error[min(int(np.ceil(rank)), count - 1)]),
        "missing": gone + 2 * np.sqrt(gone * (1 - gone) / judged) + 2 / judged,
        "left_out": contacts.left_out,
    }
    return figures, upper

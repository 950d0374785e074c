"""Tests for missing surface, for forces that differ, and for how much force a wall holds."""

import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.shares import (
    JUDGED,
    MISSING_LIMIT,
    PATCH_LIMIT,
    ROUNDING,
    STRONG_LIMIT,
    differences,
    shares,
)

#: A wall gives way early if it holds less than HOLDS times what the exact one does at the same
#: point, and breaks if it holds less than BREAKS times that. EARLY and BROKEN limit the areas of
#: such walls. Next to edges every smooth field gives way early: it rounds the crease between the
#: two walls.
HOLDS, BREAKS = 0.9, 0.5
EARLY, BROKEN = 0.2, MISSING_LIMIT
#: A wall's force is tested at _STEPS depths in a geometric sequence. The first is the share
#: _SHALLOWEST of the greatest depth, or the share _OF_RADIUS of the inscribed radius if that is
#: less.
_STEPS, _SHALLOWEST, _OF_RADIUS = 96, 0.01, 0.25
#: A push ends at this multiple of the depth at which the exact wall exerts the device's largest
#: force: other fields' walls may be softer.
_DEEPER = 1.25


def absence(answer, contacts):
    """Measure the share of the surface on which the force is missing, or feels different.

    Returns
    -------
    dict
        Figures of `pandis.pipeline.geometry.shares.shares`; ``left_out``, the share of the area
        that is too thin to be judged; ``limit`` of ``missing`` and ``left_out``; ``passed``.
    """
    probes = contacts.pressed
    figures = shares(penalty_force(*answer(probes.points)), probes)
    figures["left_out"] = contacts.left_out
    passed = max(figures["missing"], contacts.left_out) <= MISSING_LIMIT
    return figures | {"limit": MISSING_LIMIT, "passed": passed}


def otherness(answer, contacts):
    """Measure the share of the surface on which the force feels strongly different.

    Returns
    -------
    dict
        Figures of `pandis.pipeline.geometry.shares.differences` on the deep contact set;
        ``limit``, ``patch_limit``, ``passed``.
    """
    probes = contacts.sets["contact-deep"]
    figures = differences(penalty_force(*answer(probes.points)), probes)
    return figures | {
        "left_out": contacts.left_out,
        "limit": STRONG_LIMIT,
        "patch_limit": PATCH_LIMIT,
        "passed": figures["strongly_felt"] <= STRONG_LIMIT and figures["patch"] <= PATCH_LIMIT,
    }


def holding(answer, places, scale, *, device):
    """Return the largest force (n,), N, that resists a straight push inward from surface points.

    The push ends where no force resists it, or somewhat deeper than the depth at which an exact
    wall pushes with the device's largest force.

    Parameters
    ----------
    answer : callable
    places : pandis.pipeline.geometry.places.Stratified
    scale : pandis.base.physical.Scale
    device : pandis.pipeline.judge.stress.physical.Device
    """
    deepest = _DEEPER * device.force_limit / scale.newtons
    first = np.minimum(_SHALLOWEST * deepest, _OF_RADIUS * places.radius)
    depth = np.geomspace(first, np.full(len(first), deepest), _STEPS, axis=1)
    way = places.feet[:, None] - depth[:, :, None] * places.outward[:, None]
    force = penalty_force(*answer(way.reshape(-1, 3))).reshape(way.shape)
    against = np.einsum("nsk,nk->ns", force, places.outward)
    begun = np.logical_or.accumulate(against > 0, axis=1)
    broken = np.logical_or.accumulate(begun & ~(against > 0), axis=1)
    return np.where(broken, 0.0, against).max(axis=1) * scale.newtons


def wanted_force(exact, places, scale, *, device):
    """Return the force (n,), N, that walls must hold.

    It is 0.9 of what the exact walls hold, or the device's largest force if that is less.
    """
    return np.minimum(HOLDS * holding(exact, places, scale, device=device), device.force_limit)


def hold(answer, places, force, *, scale, device):
    """Measure the area of walls that give way before the exact ones do at the same point.

    Parameters
    ----------
    answer : callable
    places : pandis.pipeline.geometry.places.Stratified
    force : ndarray, shape (n,)
        From `wanted_force`.
    scale : pandis.base.physical.Scale
    device : pandis.pipeline.judge.stress.physical.Device

    Returns
    -------
    dict
        ``gives_way``: share of the area where less than ``force`` is held; ``breaks``: where less
        than half of it is held and, away from thin walls, at least 0.05 N is missing;
        ``of_exact``: the smallest share of ``force`` that is held at any point; ``limit``,
        ``broken_limit``, ``passed``.
    """
    forces = holding(answer, places, scale, device=device)
    share = forces / np.maximum(force, 1e-12)
    short = force - forces >= np.where(places.wall, ROUNDING, JUDGED)
    early = float(places.weight[share < 1 - 1e-6].sum())
    broken = float(places.weight[(share < BREAKS) & short].sum())
    return {
        "gives_way": early,
        "breaks": broken,
        "of_exact": float(share.min()),
        "limit": EARLY,
        "broken_limit": BROKEN,
        "passed": bool(early <= EARLY and broken <= BROKEN),
    }

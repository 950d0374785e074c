"""Contacts where there are none, surface that is missing, and how hard a wall holds."""

import numpy as np

from pandis.forces import penalty_force
from pandis.geometry.measure import JUDGED, MISSING_LIMIT, shares
from pandis.geometry.sampling import PROBE_DEPTHS

#: Share of the free space next to the surface in which a ghost may push with 0.05 N or more.
GHOSTS = 0.005
#: As high above the surface as a wall is deep where it pushes with this (N), there may be none.
CLEAR = 0.2
#: A wall gives way early if it holds less than this share of what the exact one does at the same
#: point, and breaks if it holds less than half of that; so much of the area may have such walls.
#: Next to an edge every smooth field gives way early: it rounds the crease between the two walls.
HOLDS, BREAKS = 0.9, 0.5
EARLY, BROKEN = 0.2, MISSING_LIMIT
#: Depths at which a wall is asked how hard it holds: each so many times the one before, down to
#: a hundredth of the deepest.
_STEPS, _SHALLOWEST = 96, 0.01
#: A wall is asked somewhat deeper than where the exact one has the force wanted: it may be softer.
_DEEPER = 1.25


def ghosts(answer, engine, surface, count, scale, rng):
    """Look for contacts where there are none, and for their absence anywhere inside.

    Next to the surface, and anywhere in the box.

    Returns
    -------
    dict
        ``ghosts``: the share of the free space up to 0.04 above the surface with a force of 0.05 N
        or more; ``far_n``: the largest force (N) where the exact wall, were the point as deep as it
        is high, would push with 0.2 N or more; ``largest_n``: the largest anywhere; ``limit``;
        ``passed``: few near ghosts, and none far. Told, and not judged: ``hollow``, the share of
        points anywhere inside with no force; ``core``, the mean error of the force deeper than 0.04
        as a share of the mean force there (None where no part is so thick).
    """
    feet, outward, _, _ = surface.draw(count, rng)
    near = feet + rng.uniform(0, PROBE_DEPTHS["deep"], count)[:, None] * outward
    points = np.concatenate([near, rng.uniform(-1, 1, (count, 3))])
    beside = np.arange(2 * count) < count
    inside_box = (np.abs(points) <= 1).all(axis=1)
    points, beside = points[inside_box], beside[inside_box]
    height, direction = engine.distance_and_normal(points, check=False)
    vectors, free = penalty_force(*answer(points)), height > 0
    core = height < -PROBE_DEPTHS["deep"]
    depth = -height[core]
    off = np.linalg.norm(vectors - penalty_force(height, direction), axis=1)[core]
    sizes = np.linalg.norm(vectors, axis=1)
    inside = sizes[height < 0]
    beside, height, force = beside[free], height[free], sizes[free] * scale.newtons
    felt = force >= JUDGED
    share = float(felt[beside].mean()) if beside.any() else 0.0
    far = float(force[height * scale.newtons >= CLEAR].max(initial=0))
    return {
        "ghosts": share,
        "far_n": far,
        "largest_n": float(force.max(initial=0)),
        "hollow": float((inside == 0).mean()) if len(inside) else 0.0,
        "core": float(off.mean() / depth.mean()) if core.any() else None,
        "limit": GHOSTS,
        "passed": bool(share <= GHOSTS and far < JUDGED),
    }


def absence(answer, contacts):
    """Count the share of the surface on which the force is missing, or feels different.

    Returns
    -------
    dict
        What `pandis.geometry.measure.shares` counts; ``limit``, ``passed``.
    """
    probes = contacts.pressed
    figures = shares(penalty_force(*answer(probes.points)), probes.force, contacts.newtons)
    return figures | {"limit": MISSING_LIMIT, "passed": figures["missing"] <= MISSING_LIMIT}


def holding(answer, places, scale, device):
    """Return the largest force (n,), newtons, against a push straight in from surface points.

    It ends where the force no longer pushes back, or beyond the device's largest.

    Parameters
    ----------
    answer : callable
    places : pandis.geometry.measure.Stratified
    scale : pandis.geometry.physical.Scale
    device : pandis.stress.physical.Device
    """
    deepest = _DEEPER * device.force_limit / scale.newtons
    depth = deepest * np.geomspace(_SHALLOWEST, 1, _STEPS)
    way = places.feet[:, None] - depth[:, None] * places.outward[:, None]
    force = penalty_force(*answer(way.reshape(-1, 3))).reshape(way.shape)
    against = np.einsum("nsk,nk->ns", force, places.outward)
    begun = np.logical_or.accumulate(against > 0, axis=1)
    broken = np.logical_or.accumulate(begun & ~(against > 0), axis=1)
    return np.where(broken, 0.0, against).max(axis=1) * scale.newtons


def wanted_force(exact, places, scale, device):
    """Return how hard (n,) walls must hold (N): 0.9 of the exact ones, or the device's most."""
    return np.minimum(HOLDS * holding(exact, places, scale, device), device.force_limit)


def hold(answer, places, wanted, scale, device):
    """Count the walls that give way before the exact ones do at the same point.

    Parameters
    ----------
    answer : callable
    places : pandis.geometry.measure.Stratified
    wanted : ndarray, shape (n,)
        From `wanted_force`.
    scale : pandis.geometry.physical.Scale
    device : pandis.stress.physical.Device

    Returns
    -------
    dict
        ``gives_way``: the share of the area whose wall holds less than is wanted; ``breaks``: less
        than half of that, and by 0.05 N; ``of_exact``: the least share of it that a wall holds;
        ``limit``, ``broken_limit``, ``passed``.
    """
    forces = holding(answer, places, scale, device)
    share, short = forces / np.maximum(wanted, 1e-12), wanted - forces >= JUDGED
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

"""Contacts where there are none, contacts missed, and how hard a wall holds."""

import numpy as np

from pandis.forces import penalty_force
from pandis.frame import UNIT_SIDE

#: So far from the surface (m) a field must know the side.
MARGIN = 5e-4
#: Height and depth around the surface (m) that are looked at besides the box.
NEAR = 5e-3
#: Rays inward, their points, and how deep they go (unit frame).
_STEPS, _DEEPEST = 96, UNIT_SIDE / 2
#: A wall must hold so much of what the exact one does (median over the surface).
HOLDS = 0.9


def contacts(answer, engine, surface, count, scale, rng):
    """Look for ghost forces in free space and for missed contacts inside.

    Returns
    -------
    dict
        ``ghost_n``: the largest force, newtons, further than MARGIN outside of the surface;
        ``ghosts``: the share of such points with one; ``missed``: the share of points deeper
        than MARGIN without one; ``passed``: there are neither.
    """
    near, normals, _, _ = surface.draw(count, rng)
    height = rng.uniform(-NEAR, NEAR, count) * scale.metre
    points = np.concatenate([rng.uniform(-1, 1, (count, 3)), near + height[:, None] * normals])
    points = points[(np.abs(points) <= 1).all(axis=1)]
    distance = engine.distance_and_normal(points)[0]
    force = np.linalg.norm(penalty_force(*answer(points)), axis=1) * scale.newtons
    margin = MARGIN * scale.metre
    outside, inside = force[distance > margin], force[distance < -margin]
    ghost, missed = outside.max(initial=0), (inside == 0).mean() if len(inside) else 0.0
    return {
        "ghost_n": float(ghost),
        "ghosts": float((outside > 0).mean()) if len(outside) else 0.0,
        "missed": float(missed),
        "passed": bool(ghost == 0 and missed == 0),
    }


def holding(answer, points, normals, scale):
    """Return the largest force (n,), newtons, against a push straight in from surface points.

    It ends where the force no longer pushes back: halfway through a wall of thickness t, at
    k·t/2, the other side is nearer.
    """
    depth = np.linspace(0, _DEEPEST, _STEPS + 1)[1:]
    way = points[:, None] - depth[:, None] * normals[:, None]
    force = penalty_force(*answer(way.reshape(-1, 3))).reshape(way.shape)
    against = np.einsum("nsk,nk->ns", force, normals)
    holds = np.logical_and.accumulate(against > 0, axis=1)
    return np.where(holds, against, 0.0).max(axis=1) * scale.newtons


def hold(answer, points, normals, wanted, scale):
    """Compare how hard a field's walls hold with the exact ones.

    Parameters
    ----------
    answer : callable
    points, normals : ndarray, shape (n, 3)
        On the surface.
    wanted : ndarray, shape (n,)
        What the exact walls hold, from `holding`.
    scale : pandis.stress.physical.Scale

    Returns
    -------
    dict
        ``weakest_n``: the weakest tenth's largest force; ``of_exact``: the median share of the
        exact wall's; ``limit``, ``passed``.
    """
    found = holding(answer, points, normals, scale)
    share = float(np.median(found / np.maximum(wanted, 1e-12)))
    weakest = float(np.percentile(found, 10))
    return {"weakest_n": weakest, "of_exact": share, "limit": HOLDS, "passed": share >= HOLDS}

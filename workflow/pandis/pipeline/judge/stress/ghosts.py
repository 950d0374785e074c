"""Contacts where there are none: forces in free space."""

import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS
from pandis.pipeline.geometry.shares import JUDGED

#: Share of the free space next to the surface in which a ghost may push with 0.05 N or more.
GHOSTS = 0.005
#: Above the height that equals the depth at which a wall pushes with this (N), none is allowed.
CLEAR = 0.2
#: Cells, along each axis, of the lattice that free space is searched with: fine enough that any
#: ball of a fortieth of the box's side contains the centre of one.
_CELLS = 36
#: How often a cell is halved if the field may say inside somewhere in it.
_HALVINGS = 3
#: Most cells that are queried at once: those with the deepest centres by the field.
_MOST = 100_000


def ghosts(answer, engine, surface, count, scale, rng):
    """Look for contacts where there are none, and for missing ones anywhere inside.

    Parameters
    ----------
    answer : callable
        Answers (distance, normal) at points (n, 3), unit frame.
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    surface : pandis.pipeline.geometry.sampling.Surface
    count : int
        Points next to the surface; the rest of the box is searched by `haunted`.
    scale : pandis.base.physical.Scale
    rng : numpy.random.Generator

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
    near = near[(np.abs(near) <= 1).all(axis=1)]
    anywhere, where = haunted(answer, engine)
    points = np.concatenate([near, anywhere])
    beside = np.arange(len(points)) < len(near)
    height, direction = engine.distance_and_normal(points, check=False)
    distance, normal = (np.concatenate(pair) for pair in zip(answer(near), where, strict=True))
    vectors, free = penalty_force(distance, normal), height > 0
    sizes = np.linalg.norm(vectors, axis=1)
    force = sizes * scale.newtons
    core = height < -PROBE_DEPTHS["deep"]
    off = np.linalg.norm(vectors - penalty_force(height, direction), axis=1)[core]
    share = float((~(force < JUDGED))[beside & free].mean()) if (beside & free).any() else 0.0
    far = _far(force, height, scale)
    inside = sizes[height < 0]
    return {
        "ghosts": share,
        "far_n": far,
        "largest_n": float(force[free].max(initial=0)),
        "hollow": float((inside == 0).mean()) if len(inside) else 0.0,
        "core": float(off.mean() / -height[core].mean()) if core.any() else None,
        "limit": GHOSTS,
        "passed": bool(share <= GHOSTS and far < JUDGED),
    }


def far_ghosts(answer, engine, scale):
    """Return the largest force (N) in free space away from the surface: ``far_n`` of `ghosts`."""
    points, answers = haunted(answer, engine)
    force = np.linalg.norm(penalty_force(*answers), axis=1) * scale.newtons
    return _far(force, engine.distance_and_normal(points, check=False)[0], scale)


def _far(force, height, scale):
    # NaN is the largest: no verdict passes it
    return float(force[height * scale.newtons >= CLEAR].max(initial=0))


def haunted(answer, engine):
    """Search the box for free points that a field takes for inside.

    The search goes through the cells of a lattice, and halves those where the field's distance at
    the centre leaves room for an inside that the exact distance excludes.

    Returns
    -------
    points : ndarray, shape (n, 3), unit frame
        All centres that were asked.
    answers : tuple of ndarray
        The field's distances (n,) and normals (n, 3) there.
    """
    half = 1 / _CELLS
    axis = np.linspace(-1 + half, 1 - half, _CELLS)
    cells = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    tried = []
    for halving in range(_HALVINGS + 1):
        distance, normal = answer(cells)
        tried.append((cells, distance, normal))
        if halving == _HALVINGS:
            break
        reach = np.sqrt(3) * half
        exact = engine.distance_and_normal(cells, check=False)[0]
        # NaN may be anything
        open_ = np.flatnonzero((exact > 0) & ~(distance >= np.minimum(reach, exact / 2)))
        open_ = open_[np.argsort(distance[open_], kind="stable")[: _MOST // 8]]
        cells = (cells[open_][:, None] + half * corners).reshape(-1, 3)
        half /= 2
        if not len(cells):
            break
    points, distance, normal = (np.concatenate(columns) for columns in zip(*tried, strict=True))
    return points, (distance, normal)

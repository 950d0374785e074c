"""Tests for ghosts: forces in free space, where there is no contact."""

import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS
from pandis.pipeline.geometry.shares import JUDGED

#: Ghosts of 0.05 N or more may fill at most this share of the free space next to the surface.
GHOSTS = 0.005
#: No ghost is allowed at heights for which a wall, at an equal depth, pushes with at least this
#: force (N).
CLEAR = 0.2
#: Cells along each axis of the lattice on which free space is searched: fine enough that any ball
#: with a radius of a fortieth of the box's side contains the centre of a cell.
_CELLS = 36
#: A cell is halved up to this many times if the field's distance may be negative somewhere in it.
_HALVINGS = 3
#: Largest number of cells queried at once: those with the field's smallest distances are kept.
_MOST = 100_000


def ghosts(answer, body, count, *, scale, rng):
    """Measure forces in free space, and missing forces anywhere inside.

    Parameters
    ----------
    answer : callable
        Returns (distance, normal) at points (n, 3), unit frame.
    body : pandis.pipeline.geometry.body.Body
    count : int
        Number of points next to the surface; `haunted` searches the rest of the box.
    scale : pandis.base.physical.Scale
    rng : numpy.random.Generator

    Returns
    -------
    dict
        ``ghosts``: the share of the free space up to 0.04 above the surface with a force of 0.05 N
        or more; ``far_n``: the largest force (N) at heights for which the exact wall, at an equal
        depth, pushes with 0.2 N or more; ``largest_n``: the largest in free space; ``limit``;
        ``passed``: few ghosts near the surface, and none far from it. Reported, but not judged:
        ``hollow``, the share of points inside with no force; ``core``, the mean error of the force
        deeper than 0.04 as a share of the mean force there (None if no part is that thick).
    """
    engine = body.distance
    feet, outward, _, _ = body.surface.draw(count, rng)
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
    # max() propagates NaN, and no verdict passes with NaN
    return float(force[height * scale.newtons >= CLEAR].max(initial=0))


def haunted(answer, engine):
    """Search the box for points in free space at which a field's distance is negative.

    The search queries the cells of a lattice. It halves a cell if the field's distance at the
    cell's centre allows inside points in it, although the exact distance rules them out.

    Returns
    -------
    points : ndarray, shape (n, 3), unit frame
        All cell centres that were queried.
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
        # the comparison is negated so that NaN counts as open
        open_ = np.flatnonzero((exact > 0) & ~(distance >= np.minimum(reach, exact / 2)))
        open_ = open_[np.argsort(distance[open_], kind="stable")[: _MOST // 8]]
        cells = (cells[open_][:, None] + half * corners).reshape(-1, 3)
        half /= 2
        if not len(cells):
            break
    points, distance, normal = (np.concatenate(columns) for columns in zip(*tried, strict=True))
    return points, (distance, normal)

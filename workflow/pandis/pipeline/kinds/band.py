"""Finds the cells of a grid in a band around the surface, without testing all of them.

A distance changes by no more than the point moves. So a block whose centre
is farther from the band than half the block's diagonal does not meet the
band, and all its points have the same sign. Blocks that may meet the band are
split until they are cells. The others are known to be wholly inside or outside.
"""

from typing import NamedTuple

import numpy as np

#: Sides of the blocks at each level of splitting, in cells.
_SIDES = (32, 8, 2, 1)
#: Number of points per query of the exact distance.
_CHUNK = 1 << 18


class Band(NamedTuple):
    """Extent of a band: from ``inside`` below the surface to ``outside`` above it (unit frame)."""

    inside: float
    outside: float


def find_cells(engine, size, band, *, low, step):
    """Find the cells that may meet the band.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    size : int
        Nodes per axis.
    band : Band
    low, step : float or sequence of 3 float
        Position of the first node, and the node spacing.

    Returns
    -------
    cells : ndarray, shape (m, 3), int64
        Every cell with a point in the band, and few others.
    signs : ndarray, shape (size - 1,) * 3, int8
        0 for these cells; for the others, -1 if wholly inside, 1 if wholly outside.
    """
    count = size - 1
    low, step = np.broadcast_to(low, 3), np.broadcast_to(step, 3)
    signs = np.zeros((count,) * 3, np.int8)
    start = np.arange(0, count, _SIDES[0])
    blocks = np.stack(np.meshgrid(start, start, start, indexing="ij"), axis=-1).reshape(-1, 3)
    for level, side in enumerate(_SIDES):
        # blocks at the border may extend beyond the grid: clipping them would gain nothing
        radius = side * np.linalg.norm(step) / 2
        keep = np.empty(len(blocks), bool)
        for part in range(0, len(blocks), _CHUNK):
            piece = blocks[part : part + _CHUNK]
            distance, _ = engine.distance_and_normal(low + step * (piece + side / 2), check=False)
            meets = (distance >= -band.inside - radius) & (distance <= band.outside + radius)
            keep[part : part + _CHUNK] = meets
            _fill(signs, piece[~meets], side, values=np.where(distance[~meets] < 0, -1, 1))
        blocks = blocks[keep]
        if side > 1:
            finer = np.arange(0, side, _SIDES[level + 1])
            offsets = np.stack(np.meshgrid(finer, finer, finer, indexing="ij"), axis=-1)
            blocks = (blocks[:, None] + offsets.reshape(-1, 3)).reshape(-1, 3)
            blocks = blocks[(blocks < count).all(axis=1)]
    return blocks, signs


def _fill(signs, blocks, side, *, values):
    """Write each block's sign into all its cells."""
    if side == 1:
        signs[tuple(blocks.T)] = values
        return
    for (i, j, k), value in zip(blocks.tolist(), values.tolist(), strict=True):
        signs[i : i + side, j : j + side, k : k + side] = value


def needed_nodes(cells, size, reach):
    """Return the mask (size, size, size) of the nodes needed to interpolate in the cells.

    Parameters
    ----------
    cells : ndarray, shape (m, 3)
    size : int
    reach : int
        0: only the corners of the cell; 1: one more node on every side.
    """
    mask = np.zeros((size,) * 3, bool)
    mask[tuple(cells.T)] = True
    for axis in range(3):
        grown = mask.copy()
        for shift in range(-reach, 2 + reach):
            _shifted_or(grown, mask, axis, shift=shift)
        mask = grown
    return mask


def _shifted_or(target, source, axis, *, shift):
    size = source.shape[axis]
    to, of = [slice(None)] * 3, [slice(None)] * 3
    to[axis] = slice(max(shift, 0), size + min(shift, 0))
    of[axis] = slice(max(-shift, 0), size - max(shift, 0))
    target[tuple(to)] |= source[tuple(of)]

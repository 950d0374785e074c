"""Distances on Newton's grids: a coarse grid, and a fine one in blocks of 8³ cells near surfaces.

The layout is that of Newton's signed-distance texture (version 2 of its cache, Newton 1.8.0).
"""

from itertools import product
from typing import NamedTuple

import numpy as np

#: Fine cells and fine nodes along a block. Neighbouring blocks both store the nodes they share.
CELLS, NODES = 8, 9
#: Marks of blocks that the coarse grid represents (LINEAR), and of blocks beyond the band (EMPTY).
LINEAR, EMPTY = np.uint32(0xFFFFFFFE), np.uint32(0xFFFFFFFF)
#: The coarse grid represents a block where its error is below this share of the grid's diagonal.
FLAT = 1e-6
#: Fine nodes are fitted within this many cells of the surface: probes go no deeper.
FITTED = 4.0
#: Stopping criteria of conjugate gradients: relative residual, maximum number of iterations.
_ENOUGH, _ROUNDS = 1e-4, 60
#: Points per call; a long bake can be interrupted between calls.
_CHUNK = 1 << 18
_CORNERS = np.array(list(product((0, 1), repeat=3)))
#: Three Gauss points along a cell, and their weights.
_GAUSS = 0.5 + np.array([-0.5, 0, 0.5]) * np.sqrt(0.6), np.array([5, 8, 5]) / 18
#: Weight of errors outside; rounds of reweighting; softening, as a share of the RMS error.
_OUTSIDE, _REWEIGHTED, _SOFTLY = 0.3, 3, 0.3


class Grid(NamedTuple):
    """The fine grid: lowest corner (3,), m; cell size (3,), m; number of blocks (3,)."""

    low: np.ndarray
    cell: np.ndarray
    blocks: np.ndarray

    @classmethod
    def around(cls, vertices, margin, resolution, *, voxel):
        """Return Newton's grid around vertices (n, 3), computed with Newton's arithmetic.

        Parameters
        ----------
        margin : float
            Margin on each side, m.
        resolution : int or None
            Cells along the longest side.
        voxel : float or None
            Length of a cell, m; replaces ``resolution``.
        """
        low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
        extent = high - low
        if voxel is not None:
            resolution = max(8, -(-int(np.ceil(extent.max() / voxel)) // 8) * 8)
        cells = np.ceil(extent / (extent.max() / resolution)).astype(int)
        return cls(low.astype(float), extent / cells, -(-cells // CELLS))

    def at(self, nodes):
        """Return positions (n, 3), m, of nodes (n, 3) of the fine grid; nodes may be fractional."""
        return self.low + nodes * self.cell

    @property
    def radius(self):
        """Half a block's diagonal, m."""
        return float(np.linalg.norm(self.cell)) * CELLS / 2


class Blocks(NamedTuple):
    """Blocks near the surface, and their nodes.

    Attributes
    ----------
    places : ndarray, shape (b, 3)
        Indices of the blocks along each axis.
    nodes : ndarray, shape (u, 3)
        Their nodes in the fine grid, without duplicates.
    index : ndarray, shape (b, 9, 9, 9)
        Rows of ``nodes`` for each block, by x, y and z.
    """

    places: np.ndarray
    nodes: np.ndarray
    index: np.ndarray

    @classmethod
    def of(cls, places, grid):
        """Return the blocks at places (b, 3)."""
        span = np.arange(NODES)
        local = np.stack(np.meshgrid(span, span, span, indexing="ij"), axis=-1)
        whole = CELLS * places[:, None, None, None, :] + local
        size = CELLS * grid.blocks + 1
        keys = np.ravel_multi_index(tuple(np.moveaxis(whole, -1, 0)), size)
        unique, index = np.unique(keys, return_inverse=True)
        return cls(
            places, np.stack(np.unravel_index(unique, size), axis=-1), index.reshape(keys.shape)
        )

    def corners(self):
        """Return the rows of ``nodes`` (c, 8) at each cell's corners, and its first node (c, 3)."""
        index = [self.index[:, x : x + CELLS, y : y + CELLS, z : z + CELLS] for x, y, z in _CORNERS]
        cells = np.stack([part.reshape(-1) for part in index], axis=-1)
        return cells, self.nodes[cells[:, 0]]


def build(distance, grid, band, *, fitted, progress):
    """Return coarse distances, blocks, values at their nodes, and the places of flat blocks.

    Parameters
    ----------
    distance : callable
        Maps points (n, 3) to distances (n,), both in metres.
    grid : Grid
    band : float
        Distance from the surface up to which blocks are stored, m.
    fitted : bool
        Whether to choose node values that minimise the interpolation error near the surface
        (`fit`), rather than the distances at the nodes.
    progress : callable
        Called as ``progress(done, total)``, in points.

    Returns
    -------
    coarse : ndarray, shape (w + 1, h + 1, d + 1)
    blocks : Blocks
    values : ndarray, shape (u,)
        Values of the blocks' nodes.
    flat : ndarray, shape (f, 3)
        Places of blocks that the coarse grid represents.
    """
    coarse = _ask(distance, grid.at(CELLS * _lattice(grid.blocks + 1)), lambda *_: None)
    coarse = coarse.reshape(grid.blocks + 1)
    middles = CELLS * (_lattice(grid.blocks) + 0.5)
    near = np.abs(_ask(distance, grid.at(middles), lambda *_: None)) < band + grid.radius
    blocks = Blocks.of(_lattice(grid.blocks)[near], grid)
    values = _ask(distance, grid.at(blocks.nodes), progress)
    bent = _bent(coarse, blocks, values) >= FLAT * np.linalg.norm(grid.blocks * CELLS * grid.cell)
    flat, bent_blocks = blocks.places[~bent], Blocks.of(blocks.places[bent], grid)
    values = values[np.isin(_keys(blocks.nodes, grid), _keys(bent_blocks.nodes, grid))]
    if fitted and len(bent_blocks.places):
        values = fit(distance, grid, bent_blocks, values=values, progress=progress)
    return coarse, bent_blocks, values, flat


def fit(distance, grid, blocks, *, values, progress):
    """Return node values (u,) that minimise the interpolation error near the surface.

    Iteratively reweighted least squares minimises the sum of absolute errors at the Gauss points of
    all cells near the surface. Each round derives its weights from the errors of the previous one.
    Plain least squares would favour the few cells at creases, which no values can fit. Errors
    inside count for more than errors outside, because forces act there. Nodes farther from the
    surface keep the distances given in ``values``.
    """
    corners, first = blocks.corners()
    near = np.abs(values[corners]).min(axis=1) < FITTED * grid.cell.max()
    corners, first = corners[near], first[near]
    spots, shares = (np.array(list(product(each, repeat=3))) for each in _GAUSS)
    weights = np.prod(np.where(_CORNERS, spots[:, None], 1 - spots[:, None]), axis=2)
    count, share = len(values), np.prod(shares, axis=1)
    # mask of the nodes whose eight cells are all near the surface
    whole = np.bincount(corners.ravel(), minlength=count) == len(_CORNERS)

    def gathered(of_cells):
        return whole * np.bincount(corners.ravel(), of_cells.ravel(), count)

    off, counts = (np.empty((len(corners), len(spots)), np.float32) for _ in range(2))
    step = max(1, _CHUNK // len(spots))
    for start in range(0, len(corners), step):
        part = slice(start, start + step)
        points = grid.at((first[part, None] + spots).reshape(-1, 3))
        targets = distance(points).reshape(-1, len(spots))
        off[part] = targets - values[corners[part]] @ weights.T
        counts[part] = share * np.where(targets < 0, 1, _OUTSIDE)
        progress(min(start + step, len(corners)), len(corners))
    change, weight = np.zeros(count), counts
    for _ in range(_REWEIGHTED):
        left = off - change[corners] @ weights.T
        usual = np.sqrt((counts * left**2).sum() / counts.sum())
        change += _least_squares(corners, weights, weight, left=left, gathered=gathered)
        left = off - change[corners] @ weights.T
        weight = counts / np.sqrt(left**2 + (_SOFTLY * usual) ** 2)
    return values + change


def _least_squares(corners, weights, weight, *, left, gathered):
    """Return the node changes that minimise the weighted squared residuals ``left`` (c, points).

    The method is conjugate gradients with a diagonal preconditioner.
    """
    diagonal = np.maximum(gathered(weight @ weights**2), np.finfo(np.float32).tiny)
    rest = gathered((weight * left) @ weights)
    scaled = rest / diagonal
    change, way, size = np.zeros(len(rest)), scaled, rest @ scaled
    enough = _ENOUGH**2 * size
    for _ in range(_ROUNDS):
        if size <= enough:
            break
        pushed = gathered((weight * (way[corners] @ weights.T)) @ weights)
        step = size / (way @ pushed)
        change += step * way
        rest = rest - step * pushed
        scaled = rest / diagonal
        before, size = size, rest @ scaled
        way = scaled + size / before * way
    return change


def _ask(distance, points, progress):
    parts = []
    for start in range(0, len(points), _CHUNK):
        parts.append(distance(points[start : start + _CHUNK]))
        progress(min(start + _CHUNK, len(points)), len(points))
    return np.concatenate(parts) if parts else np.zeros(0)


def _lattice(size):
    return np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1).reshape(-1, 3)


def _keys(nodes, grid):
    return np.ravel_multi_index(tuple(nodes.T), CELLS * grid.blocks + 1)


def _bent(coarse, blocks, values):
    """Return the largest deviation (b,) of each block from the coarse grid."""
    share = np.arange(NODES) / CELLS
    along = np.stack([1 - share, share])
    x, y, z = blocks.places.T
    corner = np.stack([coarse[x + i, y + j, z + k] for i, j, k in _CORNERS], axis=-1)
    interpolated = np.einsum(
        "bijk,ix,jy,kz->bxyz", corner.reshape(-1, 2, 2, 2), along, along, along
    )
    return np.abs(values[blocks.index] - interpolated).max(axis=(1, 2, 3), initial=0)

"""Distances on Newton's grids: a coarse one, and near surfaces blocks of 8³ cells of a fine one.

The layout is that of Newton's texture of signed distances (version 2 of its cache, Newton 1.8.0).
"""

from itertools import product
from typing import NamedTuple

import numpy as np

#: Cells of the fine grid along a block, and nodes: neighbours keep the nodes between them twice.
CELLS, NODES = 8, 9
#: Blocks that the coarse grid stands for (LINEAR), and those beyond the band (EMPTY).
LINEAR, EMPTY = np.uint32(0xFFFFFFFE), np.uint32(0xFFFFFFFF)
#: A block is left to the coarse grid if that is no farther off than this share of the diagonal.
FLAT = 1e-6
#: Fine nodes are fitted where the surface is not farther than so many cells: probes go no deeper.
FITTED = 4.0
#: When conjugate gradients end: the residual, as a share of the first one, and the most rounds.
_ENOUGH, _ROUNDS = 1e-4, 60
#: Points of a call: in between, a long bake can be interrupted.
_CHUNK = 1 << 18
_CORNERS = np.array(list(product((0, 1), repeat=3)))
#: Three points of Gauss along a cell, and their weights.
_GAUSS = 0.5 + np.array([-0.5, 0, 0.5]) * np.sqrt(0.6), np.array([5, 8, 5]) / 18
#: How much an error outside counts; how often weights follow the errors, and how softly.
_OUTSIDE, _REWEIGHTED, _SOFTLY = 0.3, 3, 0.3


class Grid(NamedTuple):
    """The fine grid: its lowest corner (3,), its cells (3,), metres, and blocks along each axis."""

    low: np.ndarray
    cell: np.ndarray
    blocks: np.ndarray

    @classmethod
    def around(cls, vertices, margin, resolution, voxel):
        """Return the grid that Newton lays around vertices (n, 3), by its own arithmetic.

        Parameters
        ----------
        margin : float
            Metres, on each side.
        resolution : int or None
            Cells of the longest side.
        voxel : float or None
            The length of a cell, in metres, instead.
        """
        low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
        extent = high - low
        if voxel is not None:
            resolution = max(8, -(-int(np.ceil(extent.max() / voxel)) // 8) * 8)
        cells = np.ceil(extent / (extent.max() / resolution)).astype(int)
        return cls(low.astype(float), extent / cells, -(-cells // CELLS))

    def at(self, nodes):
        """Return where nodes (n, 3), whole numbers or not, of the fine grid lie, metres."""
        return self.low + nodes * self.cell

    @property
    def radius(self):
        """Half of the diagonal of a block, metres."""
        return float(np.linalg.norm(self.cell)) * CELLS / 2


class Blocks(NamedTuple):
    """Blocks near the surface, and their nodes.

    Attributes
    ----------
    places : ndarray, shape (b, 3)
        In blocks along each axis.
    nodes : ndarray, shape (u, 3)
        Those of the fine grid, each once.
    index : ndarray, shape (b, 9, 9, 9)
        The nodes of each block, by x, y and z.
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
        """Return the nodes (c, 8) of all cells, and the first node (c, 3) of each."""
        index = [self.index[:, x : x + CELLS, y : y + CELLS, z : z + CELLS] for x, y, z in _CORNERS]
        cells = np.stack([part.reshape(-1) for part in index], axis=-1)
        return cells, self.nodes[cells[:, 0]]


def build(distance, grid, band, fitted, progress):
    """Return coarse distances, blocks, their distances, and which blocks are flat.

    Parameters
    ----------
    distance : callable
        Points (n, 3) in metres to distances (n,) in metres.
    grid : Grid
    band : float
        How far from the surface blocks are kept, metres.
    fitted : bool
        Choose the values of nodes so that the interpolated distance is off as little as can be near
        the surface (`fit`), instead of taking the distances there.
    progress : callable
        Told how much of the points is done: ``progress(done, total)``.

    Returns
    -------
    coarse : ndarray, shape (w + 1, h + 1, d + 1)
    blocks : Blocks
    values : ndarray, shape (u,)
        Values of the blocks' nodes.
    flat : ndarray, shape (f, 3)
        Places of blocks that the coarse grid stands for.
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
        values = fit(distance, grid, bent_blocks, values, progress)
    return coarse, bent_blocks, values, flat


def fit(distance, grid, blocks, values, progress):
    """Return node values (u,) that minimise the interpolation error near the surface.

    The sum of absolute errors at Gauss points, in every cell near the surface, is minimised by
    iteratively reweighted least squares: the weights follow the errors of the previous round. Plain
    least squares would favour the few cells at creases, which no values can fit. Errors inside
    count for more than errors outside, since forces act there. Nodes farther from the surface keep
    their distances.
    """
    corners, first = blocks.corners()
    near = np.abs(values[corners]).min(axis=1) < FITTED * grid.cell.max()
    corners, first = corners[near], first[near]
    spots, shares = (np.array(list(product(each, repeat=3))) for each in _GAUSS)
    weights = np.prod(np.where(_CORNERS, spots[:, None], 1 - spots[:, None]), axis=2)
    count, share = len(values), np.prod(shares, axis=1)
    whole = np.bincount(corners.ravel(), minlength=count) == len(_CORNERS)  # none is left out

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
        change += _least_squares(corners, weights, weight, left, gathered)
        left = off - change[corners] @ weights.T
        weight = counts / np.sqrt(left**2 + (_SOFTLY * usual) ** 2)
    return values + change


def _least_squares(corners, weights, weight, left, gathered):
    """Return the node changes that minimise the weighted squared residuals ``left`` (c, points).

    Solved by conjugate gradients with a diagonal preconditioner.
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
    """Return how far (b,) blocks are from what the coarse grid says, at most."""
    share = np.arange(NODES) / CELLS
    along = np.stack([1 - share, share])
    x, y, z = blocks.places.T
    corner = np.stack([coarse[x + i, y + j, z + k] for i, j, k in _CORNERS], axis=-1)
    interpolated = np.einsum(
        "bijk,ix,jy,kz->bxyz", corner.reshape(-1, 2, 2, 2), along, along, along
    )
    return np.abs(values[blocks.index] - interpolated).max(axis=(1, 2, 3), initial=0)

"""The `spline` field: tricubic B-splines whose coefficients are stored only where they are needed.

There are three lattices:

- *Base* is coarse, with 16-bit coefficients. It covers all points inside the object and in the band
  around the surface.
- *Fine* is 3.5 times as fine, with 8-bit coefficients. It is added to the base in the blocks where
  the base has its largest errors, so its bytes are spent on creases, thin parts and the surface
  itself.
- *Far* is very coarse and covers the whole box. It is used beyond the band, in free space, where no
  force acts. The distance there is at least that at the band's edge, and one bit per block of cells
  stores the side.

However deep a probe is pressed, it stays where the sum of base and fine applies. That sum is twice
continuously differentiable, and its gradient once.
"""

import numpy as np
from scipy.ndimage import convolve1d

from pandis.base.streams import SPLINE, generator
from pandis.engine.spline import BLOCK, Lattice, block_count, kept_nodes, pack
from pandis.pipeline.kinds.band import Band, find_cells
from pandis.pipeline.kinds.record import SplineRecord
from pandis.pipeline.kinds.spline.fit import Level, Targets, fit, residual

#: Nodes of the base lattice per node of the fine lattice, along an axis.
BASE_SHARE = 1 / 3.5
#: Share of the fine blocks near the surface that is worth storing.
FINE_SHARE = 0.5
FAR_SIZE, FAR_LOW = 13, -1.2
#: Sizes (nodes per axis of the fine lattice) that are tried for a budget in bytes.
SIZES = (32, 40, 48, 56, 64, 72, 80, 96, 112, 128, 144, 160, 176, 192, 208, 224, 240, 256, 288, 320)
#: Bytes of a fine block (8 coefficients of 8 bits), and of a brick's mask and base.
_FINE_BLOCK, _BRICK_BYTES = 8, 12
#: Weights of points outside the surface (where there is no force) and of points below the band.
_OUTSIDE_WEIGHT, _CORE_WEIGHT = 0.2, 0.05
#: The weights of points deeper than _TURNS times the inscribed radius are multiplied by
#: _TURN_WEIGHT: no smooth function fits where the force reverses, and trying to fit one spoils the
#: fit closer to the surface.
_TURNS, _TURN_WEIGHT = 0.92, 0.05
#: Depth to which the base is kept. It is greater than the depth of any point.
_CORE = 2.0
#: Number of additional sample points below the band, relative to the others, and their maximum
#: depth (unit frame), which a typical device reaches with its largest force.
_CORE_SHARE, _CORE_DEPTH = 0.125, 0.3
#: Minimum samples per fine coefficient. Each sample provides a distance and a direction.
_SAMPLES = 2
FEWEST_SAMPLES, MOST_SAMPLES = 100_000, 800_000
_BASE_ROUNDS, _FINE_ROUNDS, _STEPS = 2, 3, 10


class SplineFit:
    """Makes the splines of one mesh.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    band : pandis.pipeline.kinds.band.Band
    seed : int
    count : int
        Number of sample points.
    """

    def __init__(self, body, band, seed, *, count=MOST_SAMPLES):
        self.engine, self.surface = body.distance, body.surface
        self.band = Band(*band)
        self.seed = seed
        self.targets = self._draw(count)

    def _draw(self, count):
        """Draw targets. Five eighths lie near the surface, at most about 0.01 deep (unit frame).

        Additional targets lie below the band, where only the base has coefficients.
        """
        rng = generator(self.seed, SPLINE)
        shallow, inside = count * 5 // 8, self.band.inside
        parts = []
        for size, highest, deepest in (
            (shallow, min(0.002, self.band.outside), min(0.0115, inside)),
            (count - shallow, min(0.01, self.band.outside), inside),
            (int(_CORE_SHARE * count), -inside, max(_CORE_DEPTH, inside)),
        ):
            points, normals, _, _ = self.surface.draw(size, rng)
            parts.append(points + rng.uniform(-deepest, highest, size)[:, None] * normals)
        points = np.concatenate(parts)
        points = points[(np.abs(points) < 1).all(axis=1)]
        points = points[np.argsort(_order(points), kind="stable")]
        distance, normal = self.engine.distance_and_normal(points)
        known = distance >= -max(_CORE_DEPTH, inside)
        known &= distance <= self.band.outside
        points, distance, normal = points[known], distance[known], normal[known]
        weight = np.where(distance < 0, 1.0, _OUTSIDE_WEIGHT)
        weight[distance < -inside] = _CORE_WEIGHT
        weight[self._turning(points, distance, normal)] *= _TURN_WEIGHT
        return Targets(points, distance, normal, weight)

    def _turning(self, points, distance, normal):
        """Return the indices (m,) of points deeper than _TURNS times the inscribed radius there."""
        inside = np.flatnonzero(distance < 0)
        depth = -distance[inside] / _TURNS
        # deeper along the same normal: if another wall is nearer there, the point is past _TURNS
        further = points[inside] + (depth + distance[inside])[:, None] * -normal[inside]
        deeper = self.engine.distance_and_normal(further, check=False)[0]
        return inside[-deeper < depth * (1 - 1e-6)]

    def choose_size(self, budget):
        """Return the finest size at which FINE_SHARE of the blocks fits into ``budget`` bytes."""
        best = None
        for size in SIZES:
            blocks = self._base_blocks(base_size(size))[0]
            fine = FINE_SHARE * np.count_nonzero(self._count_blocks(size, None))
            if _fixed_bytes(size, blocks) + fine * (_FINE_BLOCK + 1) > budget:
                break
            best = size
        return best

    def build(self, size, budget, progress):
        """Fit a spline.

        Parameters
        ----------
        size : int
            Nodes per axis of the fine lattice.
        budget : float or None
            Limit on the bytes; None keeps FINE_SHARE of the fine blocks near the surface.
        progress : pandis.base.progress.Progress

        Returns
        -------
        arrays, attributes : dict
            As stored in ``grid-spline-….zarr.zip``.
        """
        total = (_BASE_ROUNDS + _FINE_ROUNDS) * _STEPS
        report = progress("fit", total, "steps")
        coarse = base_size(size)
        blocks, outside = self._base_blocks(coarse)
        base_masks = pack(blocks)
        lattice = box_lattice(coarse)
        inside_grid = _inside(base_masks, lattice.size)
        level = Level(lattice, _flat(kept_nodes(base_masks), lattice.size)[inside_grid])
        places = lattice.places(level.nodes)
        start = [self.engine.distance_and_normal(places, check=False)[0]]
        start = fit(
            [level], start, self.targets, rounds=_BASE_ROUNDS, steps=_STEPS, report=report.update
        )
        score = self._score(size, residual([level], start, self.targets) * self.targets.weight)
        fine_masks = pack(self._choose(size, score, blocks, budget=budget))
        lattice = box_lattice(size)
        fine_inside = _inside(fine_masks, lattice.size)
        fine_nodes = _flat(kept_nodes(fine_masks), lattice.size)[fine_inside]
        levels = [level, Level(lattice, fine_nodes)]
        targets, count = self.targets, _SAMPLES * len(levels[1].nodes)
        if count > len(targets.points):
            targets = self._draw(count)
        start.append(np.zeros(len(levels[1].nodes)))
        done = _BASE_ROUNDS * _STEPS
        fitted = fit(
            levels,
            start,
            targets,
            rounds=_FINE_ROUNDS,
            steps=_STEPS,
            report=lambda n: report.update(done + n),
        )
        far = self._far()
        stored, scales = {}, {}
        for name, values, mask, there, kind in (
            ("base", fitted[0], base_masks, inside_grid, np.int16),
            ("fine", fitted[1], fine_masks, fine_inside, np.int8),
        ):
            every = np.zeros(len(there))
            every[there] = values
            stored[f"{name}_coefficients"], scales[name] = quantise(every.reshape(-1, 8), kind)
            stored[f"{name}_masks"] = mask
        stored["far_coefficients"], scales["far"] = quantise(far, np.int16)
        stored["outside"] = np.packbits(outside.reshape(-1))
        record = SplineRecord(
            content="spline",
            size=size,
            base_size=coarse,
            far_size=FAR_SIZE,
            far_low=FAR_LOW,
            scales=scales,
            band=self.band._asdict(),
        )
        return stored, record.attributes()

    def _base_blocks(self, size):
        """Return masks (b, b, b) of blocks that the band needs, and blocks with cells outside."""
        lattice = box_lattice(size)
        everything = self.band._replace(inside=_CORE)
        step = -2 * lattice.low / (lattice.size - 1)
        cells, signs = find_cells(self.engine, lattice.size, everything, low=lattice.low, step=step)
        count, last = block_count(lattice.size), lattice.size - 1
        padded = np.zeros((count * BLOCK,) * 3, np.int8)
        padded[:last, :last, :last] = signs
        split = padded.reshape(count, BLOCK, count, BLOCK, count, BLOCK)
        positive, negative = ((split == s).any(axis=(1, 3, 5)) for s in (1, -1))
        # one bit cannot store two signs, so cells of blocks with both count as cells of the band
        both = np.argwhere(positive & negative)
        if len(both):
            corner = np.stack(np.unravel_index(np.arange(8), (2, 2, 2)), axis=1)
            more = (BLOCK * both[:, None] + corner).reshape(-1, 3)
            cells = np.concatenate([cells, more])
        cells = cells[((cells >= 1) & (cells <= lattice.size - 3)).all(axis=1)]
        blocks = np.zeros((count,) * 3, bool)
        for shift in np.ndindex(3, 3, 3):
            blocks[tuple(np.minimum((cells - 1) // 2 + shift, (cells + 2) // 2).T)] = True
        return blocks, positive

    def _count_blocks(self, size, values):
        """Return the sum of the targets' values (1 each if None) in every fine block."""
        lattice = box_lattice(size)
        count = block_count(lattice.size)
        node = (self.targets.points - lattice.low) * lattice.per_step
        block = (node / BLOCK).astype(np.int64)
        flat = np.ravel_multi_index(tuple(np.clip(block, 0, count - 1).T), (count,) * 3)
        return np.bincount(flat, values, count**3).reshape((count,) * 3)

    def _score(self, size, error):
        """Return the possible gain of each fine block: the base's error in and around it."""
        score = self._count_blocks(size, error)
        for axis in range(3):
            score = convolve1d(score, [0.25, 0.5, 0.25], axis=axis, mode="constant")
        return score

    def _choose(self, size, score, base_blocks, *, budget):
        """Return a mask (b, b, b) of the blocks to keep: as many of the best as fit."""
        order = np.argsort(-score.reshape(-1), kind="stable")
        order = order[: np.count_nonzero(score)]
        if budget is None:
            room = int(FINE_SHARE * np.count_nonzero(self._count_blocks(size, None)))
        else:
            room, free = 0, budget - _fixed_bytes(size, base_blocks)
            # each block costs its coefficients, and the first one in a brick also costs the brick
            brick = np.stack(np.unravel_index(order, score.shape), axis=1) // 4
            flat = np.ravel_multi_index(tuple(brick.T), (len(score) // 4,) * 3)
            new = np.zeros(len(flat), bool)
            new[np.unique(flat, return_index=True)[1]] = True
            costs = np.cumsum(_FINE_BLOCK + _BRICK_BYTES * new)
            room = int(np.searchsorted(costs, free, side="right"))
        chosen = np.zeros(score.size, bool)
        chosen[order[:room]] = True
        return chosen.reshape(score.shape)

    def _far(self):
        """Return the dense coefficients (FAR_SIZE,) * 3 of the far lattice."""
        lattice = Lattice(FAR_SIZE, FAR_LOW)
        nodes = np.arange(FAR_SIZE**3)
        rng = np.random.default_rng(0)  # one jittered point in every eighth of a cell
        cells = np.stack(np.meshgrid(*[np.arange(2, 2 * FAR_SIZE - 4)] * 3, indexing="ij"), -1)
        cells = cells.reshape(-1, 3)
        points = FAR_LOW + lattice.step * (cells + rng.random(cells.shape)) / 2
        distance, normal = self.engine.distance_and_normal(points, check=False)
        targets = Targets(points, distance, normal, np.ones(len(points)))
        start = [self.engine.distance_and_normal(lattice.places(nodes), check=False)[0]]
        return fit([Level(lattice, nodes)], start, targets, rounds=1, steps=_STEPS)[0].reshape(
            (FAR_SIZE,) * 3
        )


def box_lattice(size):
    """Return the lattice with ``size`` nodes across [-1, 1] and one more on either side.

    Every point in the box is then surrounded by 4 x 4 x 4 nodes.
    """
    return Lattice(size + 2, -1 - 2 / (size - 1))


def samples_for(size=None, budget=None):
    """Return the number of samples for ``size`` nodes per axis or ``budget`` bytes."""
    count = 2 * budget if budget else 32 * size**2
    return int(np.clip(count, FEWEST_SAMPLES, MOST_SAMPLES))


def base_size(size):
    """Return the base lattice's nodes per axis, given those of the fine lattice."""
    return max(12, round(size * BASE_SHARE))


def quantise(values, kind):
    """Round values to integers of ``kind``; return them and [offset, scale].

    8-bit integers are symmetric about zero, and the largest thousandth of the values is clipped.
    16-bit integers cover the whole range.
    """
    top = np.iinfo(kind).max
    if kind is np.int8:
        offset, reach = 0.0, float(np.percentile(np.abs(values), 99.9)) if values.size else 0.0
    else:
        low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
        offset, reach = (low + high) / 2, (high - low) / 2
    scale = reach / top or 1.0
    return np.clip(np.rint((values - offset) / scale), -top, top).astype(kind), [offset, scale]


def _fixed_bytes(size, base_blocks):
    """Return the size in bytes of everything but the fine blocks and their bricks."""
    bricks = base_blocks.reshape(len(base_blocks) // 4, 4, len(base_blocks) // 4, 4, -1, 4)
    occupied = bricks.any(axis=(1, 3, 5)).sum()
    places = (len(base_blocks) // 4) ** 3 + (block_count(size + 2) // 4) ** 3
    far, signs = 2 * FAR_SIZE**3, base_blocks.size / 8
    return 16 * base_blocks.sum() + _BRICK_BYTES * occupied + 2 * places + far + signs


def _flat(nodes, size):
    """Return flat indices of nodes (blocks, 8, 3); those beyond the grid get ``size**3``."""
    beyond = (nodes >= size).any(axis=-1)
    flat = (nodes[..., 0] * size + nodes[..., 1]) * size + nodes[..., 2]
    return np.where(beyond, size**3, flat).reshape(-1)


def _inside(masks, size):
    """Return a mask of the kept blocks' coefficients that belong to nodes of the grid."""
    return (kept_nodes(masks) < size).all(axis=-1).reshape(-1)


def _order(points):
    """Return a sort key that puts nearby points next to each other."""
    cell = np.clip((points + 1) * 32, 0, 63).astype(np.int64)
    return (cell[:, 0] * 64 + cell[:, 1]) * 64 + cell[:, 2]

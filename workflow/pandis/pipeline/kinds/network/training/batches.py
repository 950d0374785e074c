"""Makes the batch of each step, which depends only on the seed and the step's number."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch

from pandis.base.streams import BOX, ORDER, generator
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.records.samples import SamplesRecord

#: Number of points that are drawn together. Each is used once.
FRESH = 1 << 18
#: Number of blocks prepared in parallel while a GPU uses one, since making a block takes longer
#: than using it.
AHEAD = 5


class TrainingPoints(NamedTuple):
    """The points that a network is trained on.

    Attributes
    ----------
    samples : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``samples``.
    strata : pandis.pipeline.geometry.strata.Strata
        Draws fresh points for recipes that train on exact distances.
    """

    samples: Artifact
    strata: Strata


class Batches:
    """Cuts blocks of rows into batches.

    Parameters
    ----------
    make : callable
        Takes the number of a block; returns its rows, ndarray (at least ``per_block * size``, c).
    size : int
        Rows of a batch.
    per_block : int
        Batches per block.
    device : str
        Device that stores the batches. For a GPU the next blocks are made while one is in use.
    """

    def __init__(self, make, size, per_block, *, device):
        self.size, self.per_block, self.device = size, per_block, device
        self._make, self._number, self._rows = make, None, None
        self._pool = ThreadPoolExecutor(AHEAD) if device == "cuda" else None
        self._ahead = {}

    def batch(self, step):
        """Return the rows (size, c) of a step, float32."""
        number, position = divmod(step, self.per_block)
        if number != self._number:
            self._number, self._rows = number, self._load(number)
        return self._rows[position * self.size : (position + 1) * self.size]

    def _load(self, number):
        if self._pool is None:
            return torch.from_numpy(self._make(number))
        ready, following = self._ahead, range(number + 1, number + 1 + AHEAD)
        # the first block is made alone: it would be ready later if several began together
        rows = ready[number].result() if number in ready else self._pinned(number)
        self._ahead = {k: ready.get(k) or self._pool.submit(self._pinned, k) for k in following}
        return rows.to(self.device, non_blocking=True)

    def _pinned(self, number):
        return torch.from_numpy(self._make(number)).pin_memory()


def surface_batches(places, base, size, *, seed, device):
    """Return the batches of the paper's recipe. Each epoch is one block.

    A row contains a point on the surface, the distance and normal there, and a point in the box;
    with a base, also the base's value and gradient at both points.

    Parameters
    ----------
    places : ndarray, shape (n, 7), float32
        From `area_points` or `vertex_points`.
    base : pandis.pipeline.kinds.network.base.BaseSpline or None
    """
    size = min(size, len(places))
    per_block = len(places) // size

    def make(epoch):
        order = generator(seed, ORDER, epoch).permutation(len(places))
        rows = places[order[: per_block * size]]
        rng = generator(seed, BOX, epoch)
        box = rng.random((len(rows), 3), dtype=np.float32) * 2 - 1
        here = with_base(rows, base)[:, rows.shape[1] :]
        there = with_base(box, base)[:, box.shape[1] :]
        return np.concatenate([rows, box, here, there], axis=1)

    return Batches(make, size, per_block, device=device)


def area_points(samples):
    """Return the stored surface points, uniform by area, with distances and normals, (n, 7)."""
    low, high = SamplesRecord.of(samples).strata["surface"]
    columns = [samples.arrays[k][low:high] for k in ("points", "distance", "normal")]
    return np.column_stack(columns).astype(np.float32)


def vertex_points(body):
    """Return the vertices, their distances (zero) and their normals (n, 7), float32.

    The normal at a mesh's vertex is the mean normal of its faces, weighted by their angles there
    (Thürmer and Wüthrich 1998). The vertices of a tessellation lie exactly on the closed form.
    """
    points = body.surface.vertices
    normal = body.distance.distance_and_normal(points)[1]
    return np.column_stack([points, np.zeros(len(points)), normal]).astype(np.float32)


def fresh_batches(strata, base, size, *, seed, device):
    """Return batches of points that are drawn and labelled on demand, and used once.

    Labelling a point takes a thirtieth of the time of training on it, and a network that is
    trained on the same points repeatedly memorises them: see docs/training.md.

    Parameters
    ----------
    strata : pandis.pipeline.geometry.strata.Strata
    base : pandis.pipeline.kinds.network.base.BaseSpline or None
        See `with_base`.
    """
    per_block = max(1, FRESH // size)

    def make(block):
        rows = strata.fresh(block, per_block * size + 16)  # rounding may drop a few
        order = generator(seed, ORDER, block).permutation(len(rows))
        return np.take(with_base(rows, base), order, axis=0)

    return Batches(make, size, per_block, device=device)


def with_base(rows, base):
    """Append four columns, the base's value and gradient, to rows that begin with points.

    The base is not trained, so its values are needed only at the points of a batch.
    """
    if base is None:
        return rows
    value, gradient = base.evaluate(rows[:, :3].astype(np.float64))
    return np.column_stack([rows, value, gradient]).astype(np.float32)


def answer(output, gradient, rows):
    """Return Φ (n,) and the direction (n, 3), not yet of unit length.

    Parameters
    ----------
    output : Tensor, shape (n, 4) or (n, 1)
    gradient : Tensor, shape (n, 3), or None
        The network's gradient at the points of the rows; None if the direction is among its
        outputs.
    rows : Tensor, shape (n, 7) or (n, 11)
        Rows of `fresh_batches`; 11 columns with a base.
    """
    direction = output[:, 1:] if gradient is None else gradient
    if rows.shape[1] == 7:
        return output[:, 0], direction
    return output[:, 0] + rows[:, 7], direction + rows[:, 8:]

"""The `spline` field: see `pandis.pipeline.kinds.spline.lattices`."""

import numpy as np

from pandis.base.frame import Frame
from pandis.engine.spline import BLOCK, EDGE, Lattice, SparseSpline, block_count
from pandis.pipeline.kinds.band import Band
from pandis.pipeline.kinds.field import BOUND, INVALID, OK, Answer, Field, clamp_to_box, normalise
from pandis.pipeline.kinds.record import SplineRecord
from pandis.pipeline.kinds.spline.lattices import box_lattice

_LEVELS = ("base", "fine", "far")
#: Where the spline has smoothed a crease, points are lifted towards the surface. _LIFT is the
#: maximum lift, in steps of the base lattice. A point is lifted only if the squared length of its
#: gradient is more than _SHORT below 1.
_LIFT, _SHORT = 0.7, 0.02


class SplineField(Field):
    """Banded, refined, quantised tricubic splines.

    Parameters
    ----------
    name : str
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``grid``, with the content ``spline``.
    """

    kind = "spline"

    def __init__(self, name, artifact):
        grid, arrays = SplineRecord.of(artifact), artifact.arrays
        self.band = Band(**dict(grid.band))
        coarse = box_lattice(grid.base_size)
        self.levels = [
            SparseSpline(lattice, arrays[f"{level}_masks"], _restore(arrays, level, grid.scales))
            for level, lattice in (("base", coarse), ("fine", box_lattice(grid.size)))
        ]
        self.far = Lattice(grid.far_size, grid.far_low)
        self._beyond = _restore(arrays, "far", grid.scales)
        self._base = coarse
        self.stored = [arrays[f"{level}_coefficients"] for level in _LEVELS]
        self.scales = [grid.scales[level] for level in _LEVELS]
        count = block_count(coarse.size)
        self.outside = np.unpackbits(arrays["outside"], count=count**3).reshape((count,) * 3)
        self.side_bits = arrays["outside"]
        sizes = [*(part.nbytes for part in self.stored), self.side_bits.nbytes]
        sizes += [level.index_bytes for level in self.levels]
        super().__init__(name, Frame.of(artifact), sum(sizes))

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        return self.query(points)[:2]

    def query(self, points):
        """Return the answer with flags (unit frame). Outside the band, only the side is exact.

        The distance there is an estimate. Its magnitude is at least the band's extent on that side.
        """
        clamped, outside = clamp_to_box(points)
        clamped = np.clip(clamped, -EDGE, EDGE)
        value, gradient = np.zeros(len(points)), np.zeros((len(points), 3))
        covered = self.levels[0].add(clamped, value, gradient)
        self.levels[1].add(clamped, value, gradient)
        flag = np.full(len(points), OK, np.uint8)
        beyond = (covered < 2) | (outside > 0)
        self._sharpen(clamped, value, gradient, near=~beyond)
        rest = np.flatnonzero(beyond)
        if len(rest):
            far, gradient[rest] = self.far.evaluate(self._beyond, clamped[rest])
            cell = (np.nan_to_num(clamped[rest]) - self._base.low) * self._base.per_step
            block = tuple((np.clip(cell, 0, self._base.size - 2) // BLOCK).astype(np.int64).T)
            out = self.outside[block].astype(bool) | (outside[rest] > 0)
            value[rest] = np.where(
                out,
                np.maximum(far, self.band.outside) + outside[rest],
                np.minimum(far, -self.band.inside),
            )
            flag[rest] = BOUND
        bad = ~np.isfinite(points).all(axis=1)
        value[bad], gradient[bad], flag[bad] = np.nan, np.nan, INVALID
        return Answer(value, normalise(gradient), flag)

    def _sharpen(self, points, value, gradient, *, near):
        """Reduce, in place, the rounding of creases at points (n, 3) selected by the mask ``near``.

        Where two walls are about equally near, a spline rounds the crease between them, and its
        gradient is shorter than 1. The exact distance is linear along the path to the nearest wall.
        The field is therefore evaluated closer to the wall, where the spline rounds less, and
        extrapolated back.
        """
        missing = (1 - np.einsum("nk,nk->n", gradient, gradient) - _SHORT) / (1 - _SHORT)
        some = np.flatnonzero(near & (missing > 0) & (value < 0))
        if not len(some):
            return
        missing, down = missing[some], gradient[some]
        lift = np.minimum(_LIFT / self._base.per_step, -value[some])
        lift *= missing * missing * (3 - 2 * missing)
        up = points[some] + lift[:, None] * down
        distance, normal = np.zeros(len(some)), np.zeros((len(some), 3))
        covered = self.levels[0].add(up, distance, normal) == 2
        self.levels[1].add(up, distance, normal)
        covered &= (normal != 0).any(axis=1)
        normal = normalise(normal)
        distance -= lift * np.einsum("nk,nk->n", down, normal)
        value[some[covered]] = distance[covered]
        gradient[some[covered]] = normal[covered]


def _restore(arrays, level, scales):
    offset, scale = scales[level]
    stored = arrays[f"{level}_coefficients"].astype(np.float64)
    return (offset + scale * stored).astype(np.float32)


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    return SplineField(spec.name, artifact)

"""Fields sampled on a regular grid: the paper's baselines NN-i and Tri-i, and better ones.

`pandis.pipeline.kinds.grid.dense` describes the contents of nodes and which nodes are exact.
"""

import numpy as np
from scipy.ndimage import spline_filter

from pandis.base.frame import Frame
from pandis.engine.spline import EDGE, Lattice
from pandis.pipeline.kinds.axes import Axes, corners_of, trilinear
from pandis.pipeline.kinds.band import Band
from pandis.pipeline.kinds.field import BOUND, INVALID, OK, Answer, Field, clamp_to_box, normalise
from pandis.pipeline.kinds.grid.dense import REACH, complete, covered_cells
from pandis.pipeline.kinds.record import DenseRecord


class GridField(Field):
    """A field interpolated from a grid.

    Parameters
    ----------
    name : str
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``grid``.

    Attributes
    ----------
    rule : str
        The interpolation rule, by its name in `pandis.runtime.field.RULES`.
    """

    kind = "grid"

    @property
    def rule(self):
        """The interpolation rule."""
        return "trilinear" if self.content == "force" else "trilinear-normal"

    @property
    def nodes(self):
        """Values that the file stores, by node."""
        return self.values

    def __init__(self, name, artifact):
        grid = DenseRecord.of(artifact)
        self.content, self.band = grid.content, Band(**dict(grid.band))
        self.axes = Axes.of(grid)
        stored = artifact.arrays["values"]
        self.values, exact = complete(stored.copy(), self.content, self.axes)
        self.covered = covered_cells(exact, REACH[self.content])
        super().__init__(name, Frame.of(artifact), stored.nbytes)

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame.

        A force grid stores no distance outside the surface. It returns 0 there, with +z as the
        normal. The same holds outside its own box, which contains the surface.
        """
        clamped, outside = self._clamp(points)
        bad = np.isnan(clamped).any(axis=1)
        distance, direction = self._interpolate(np.where(bad[:, None], self.axes.low, clamped))
        if self.content != "force":
            distance = distance + outside
        else:
            distance = np.where(outside > 0, 0.0, distance)
            direction = np.where(outside[:, None] > 0, 0.0, direction)
        normal = normalise(direction)
        return np.where(bad, np.nan, distance), np.where(bad[:, None], np.nan, normal)

    def direction_length(self, points):
        """Return the length (n,) of the direction before normalisation; 1 for a force grid.

        Where this length is small, two walls are about equally near, and rounding turns the normal.
        """
        if self.content == "force":
            return np.ones(len(points))
        return np.linalg.norm(self._interpolate(self._clamp(points)[0])[1], axis=1)

    def _clamp(self, points):
        """Clamp points to the box that the nodes cover; see `clamp_to_box`."""
        return clamp_to_box(points, self.axes.low, self.axes.high)

    def query(self, points):
        """Return the answer with flags (unit frame)."""
        distance, normal = self.answer(points)
        clamped, outside = self._clamp(points)
        position = np.nan_to_num(self.axes.position(clamped))
        cell = np.minimum(position.astype(np.int64), len(self.covered) - 1)
        flag = np.where(self.covered[tuple(cell.T)] & (outside == 0), OK, BOUND).astype(np.uint8)
        flag[np.isnan(distance)] = INVALID
        return Answer(distance, normal, flag)

    def _interpolate(self, points):
        """Return the distance and a direction of any length at points in the box."""
        value = trilinear(self.values, self.axes.position(points))
        if self.content == "force":
            return -np.linalg.norm(value, axis=1), value
        return value[:, 0], value[:, 1:]


class NearestField(GridField):
    """The nearest node's force: the paper's NN-i."""

    rule = "nearest"

    def _interpolate(self, points):
        i, j, k = np.floor(self.axes.position(points) + 0.5).astype(np.int64).T
        value = self.values[i, j, k].astype(np.float64)
        return -np.linalg.norm(value, axis=1), value


class GradientField(GridField):
    """Trilinear distances with their gradient as the normal, which jumps between cells."""

    rule = "trilinear-gradient"

    def _interpolate(self, points):
        corners, t = corners_of(self.values, self.axes.position(points))
        x, y, z = t.T
        c = {offset: value[:, 0].astype(np.float64) for offset, value in corners.items()}

        def mix(a, b, s):
            return a * (1 - s) + b * s

        line = {(b, d): mix(c[0, b, d], c[1, b, d], x) for b in (0, 1) for d in (0, 1)}
        rise = {(b, d): c[1, b, d] - c[0, b, d] for b in (0, 1) for d in (0, 1)}
        value = mix(mix(line[0, 0], line[1, 0], y), mix(line[0, 1], line[1, 1], y), z)
        gradient = [
            mix(mix(rise[0, 0], rise[1, 0], y), mix(rise[0, 1], rise[1, 1], y), z),
            mix(line[1, 0] - line[0, 0], line[1, 1] - line[0, 1], z),
            mix(line[0, 1] - line[0, 0], line[1, 1] - line[1, 0], y),
        ]
        return value, np.stack(gradient, axis=1) * ((len(self.values) - 1) / 2)


class TricubicField(GridField):
    """A tricubic B-spline through the distances: one float per node, twice differentiable.

    The normal is the spline's gradient, so the force is continuously differentiable.
    """

    rule = "tricubic"

    def __init__(self, name, artifact):
        super().__init__(name, artifact)
        coefficients = spline_filter(self.values, order=3, output=np.float32, mode="mirror")
        # one more node on every side, which the cells at the border need
        self.coefficients = np.pad(coefficients, 1, mode="reflect")
        self.lattice = Lattice.around_box(len(self.values) - 1)

    @property
    def nodes(self):
        """Values that the file stores, by node."""
        return self.coefficients

    def _interpolate(self, points):
        within = np.clip(points, -EDGE, EDGE)
        value, gradient = self.lattice.evaluate(self.coefficients, within)
        return value, gradient

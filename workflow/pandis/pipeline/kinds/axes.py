"""Positions of a grid's nodes: on the cube [-1, 1]³, or on the box around the surface."""

from typing import NamedTuple

import numpy as np


class Axes(NamedTuple):
    """Evenly spaced nodes along each axis of a box, including its corners (unit frame).

    Attributes
    ----------
    size : int
        Nodes per axis.
    low, high : tuple of 3 float
        Opposite corners: the first node and the last.
    """

    size: int
    low: tuple
    high: tuple

    @classmethod
    def of_cube(cls, size):
        """Return the axes of [-1, 1]³."""
        return cls(size, (-1.0,) * 3, (1.0,) * 3)

    @classmethod
    def of_bounds(cls, size, engine):
        """Return axes that span the bounding box of an engine's surface; cells need not be cubes.

        Parameters
        ----------
        size : int
        engine : object
            The exact distance of a `pandis.pipeline.geometry.body.Body`.
        """
        low, high = engine.bounds
        return cls(size, tuple(low.tolist()), tuple(high.tolist()))

    @classmethod
    def of(cls, record):
        """Return the axes of a `pandis.pipeline.kinds.record.DenseRecord`."""
        return cls(record.size, record.origin, record.corner)

    def attributes(self):
        """Return the axes as stored by a `pandis.pipeline.kinds.record.DenseRecord`."""
        return {
            "size": self.size,
            "origin": list(self.low),
            "corner": list(self.high),
            "spacing": self.step.tolist(),
        }

    @property
    def step(self):
        """Node spacing, (3,)."""
        return (np.array(self.high) - np.array(self.low)) / (self.size - 1)

    def nodes(self, index):
        """Return the positions (n, 3), unit frame, of the nodes with indices (n, 3)."""
        return np.array(self.low) + self.step * index

    def position(self, points):
        """Convert points (n, 3) from the unit frame to node coordinates."""
        per_step = (self.size - 1) / (np.array(self.high) - np.array(self.low))
        return (points - np.array(self.low)) * per_step


def trilinear(values, position):
    """Interpolate values (n, n, n) or (n, n, n, c) at node coordinates (m, 3); return (m, c)."""
    corners, t = corners_of(values, position)
    x, y, z = t.T[..., None]
    line = [[corners[0, b, c] * (1 - x) + corners[1, b, c] * x for b in (0, 1)] for c in (0, 1)]
    plane = [line[c][0] * (1 - y) + line[c][1] * y for c in (0, 1)]
    return plane[0] * (1 - z) + plane[1] * z


def corners_of(values, position):
    """Return the values at the cells' corners, by corner, and the positions (m, 3) in the cells."""
    base = np.minimum(np.floor(position), len(values) - 2).astype(np.int64)
    i, j, k = base.T
    values = values if values.ndim == 4 else values[..., None]
    corners = {o: values[i + o[0], j + o[1], k + o[2]] for o in np.ndindex(2, 2, 2)}
    return corners, position - base


def slopes(values):
    """Return the central differences (n, n, n, 3) of values (n, n, n) at the nodes."""
    spacing = 2.0 / (len(values) - 1)
    return np.stack(np.gradient(values.astype(np.float64), spacing), axis=-1)

"""Where the nodes of a grid lie: on the cube [-1, 1]³, or on the box around the surface."""

from typing import NamedTuple

import numpy as np


class Axes(NamedTuple):
    """Evenly spaced nodes along each axis, from one corner of a box to the other; unit frame.

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
        """Return the axes of the box around the surface of an engine: cells need not be cubes.

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
        """Return them as a `pandis.pipeline.kinds.record.DenseRecord` stores them."""
        return {
            "size": self.size,
            "origin": list(self.low),
            "corner": list(self.high),
            "spacing": self.step.tolist(),
        }

    @property
    def step(self):
        """From node to node, (3,)."""
        return (np.array(self.high) - np.array(self.low)) / (self.size - 1)

    def nodes(self, index):
        """Return the places (n, 3) of nodes (n, 3)."""
        return np.array(self.low) + self.step * index

    def position(self, points):
        """Return where points (n, 3) lie, counted in nodes."""
        per_step = (self.size - 1) / (np.array(self.high) - np.array(self.low))
        return (points - np.array(self.low)) * per_step

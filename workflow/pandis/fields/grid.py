"""Fields sampled on a regular grid: the paper's baselines NN-i and Tri-i, and a better one.

A grid has n nodes per axis at ``linspace(-1, 1, n)`` of the unit frame. What
a node holds (``content``):

``force``
    the penetration vector -min(d, 0)·n, three floats: the force at k = 1, as
    the paper's 12 bytes per node say. Outside of the shape it is zero.
``normal``
    distance and normal, four floats, interpolated apart.
"""

import numpy as np

from pandis.fields.base import Field, clamp_to_box, normalise
from pandis.frame import Frame


class GridField(Field):
    """A field interpolated from a grid.

    Parameters
    ----------
    name : str
    artifact : pandis.artifact.Artifact
        Of kind ``grid``.
    nearest : bool
        Take the nearest node instead of interpolating trilinearly.
    """

    def __init__(self, name, artifact, nearest):
        self.values = artifact.arrays["values"]
        self.content = artifact.attributes["grid"]["content"]
        self.nearest = nearest
        frame = Frame.from_attributes(artifact.attributes["frame"])
        super().__init__(name, frame, self.values.nbytes)

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame.

        A force grid knows no distance outside: it answers 0 there, and +z for a normal.
        """
        clamped, outside = clamp_to_box(points)
        value = self._interpolate(clamped)
        if self.content == "force":
            return -np.linalg.norm(value, axis=1), normalise(value)
        return value[:, 0] + outside, normalise(value[:, 1:])

    def _interpolate(self, points):
        size = len(self.values)
        position = (points + 1.0) * ((size - 1) / 2)
        if self.nearest:
            i, j, k = np.floor(position + 0.5).astype(np.int64).T
            return self.values[i, j, k].astype(np.float64)
        base = np.minimum(np.floor(position), size - 2).astype(np.int64)
        t = (position - base)[:, :, None]
        i, j, k = base.T
        line = [
            [
                self.values[i, j + b, k + c] * (1 - t[:, 0])
                + self.values[i + 1, j + b, k + c] * t[:, 0]
                for b in (0, 1)
            ]
            for c in (0, 1)
        ]
        plane = [line[c][0] * (1 - t[:, 1]) + line[c][1] * t[:, 1] for c in (0, 1)]
        return plane[0] * (1 - t[:, 2]) + plane[1] * t[:, 2]

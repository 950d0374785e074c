"""Applies [10] to a potential that is not a distance: x² + y² + z² - 1. Unit sphere only."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.pipeline.kinds.axes import Axes, slopes, trilinear
from pandis.pipeline.kinds.field import Field, clamp_to_box, normalise


class AlgebraicField(Field):
    """Reading V of `kim`: the value interpolated from a grid is used as the distance."""

    def __init__(self, name, mesh):
        if mesh.attributes.get("shape") != "sphere":
            raise PandisError(
                f"{name}: only a sphere has this potential (x² + y² + z² - 1); use kim-N for meshes"
            )
        size = int(name.rpartition("-")[2])
        frame = Frame.of(mesh)
        # use mesh units, in which the radius is 1: the potential depends on the unit of length
        axis = (np.linspace(-1, 1, size) / frame.scale) ** 2
        square = (axis[:, None, None] + axis[:, None] + axis - 1.0) * frame.scale
        self.values = square.astype(np.float32)
        self.slopes, self.axes = slopes(self.values), Axes.of_cube(size)
        super().__init__(name, frame, self.values.nbytes)

    def answer(self, points):
        """Return the value (n,) and the normal (n, 3) at points (n, 3), in the unit frame."""
        clamped, outside = clamp_to_box(points)
        bad = np.isnan(clamped).any(axis=1)
        position = self.axes.position(np.where(bad[:, None], 0.0, clamped))
        value = trilinear(self.values, position)[:, 0] + outside
        normal = normalise(trilinear(self.slopes, position))
        return np.where(bad, np.nan, value), np.where(bad[:, None], np.nan, normal)

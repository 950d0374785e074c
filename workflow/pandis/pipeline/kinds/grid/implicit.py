"""[10]: a grid of implicit values, after Kim, Kyrikou, Desbrun & Sukhatme 2002.

The force is that of a spring to the surface, along the gradient at the probe. The gradient is
interpolated between central differences at the nodes. The paper's text was not available, so the
spring's length is inferred. Three readings are implemented: the value itself as the distance; the
distance along the gradient to the sign change of the interpolated value; the same in whole
cells.
"""

import numpy as np

from pandis.pipeline.kinds.axes import slopes, trilinear
from pandis.pipeline.kinds.field import normalise
from pandis.pipeline.kinds.grid.interpolation import GridField

#: Bisections of the last cell of a march: they locate the surface to a millionth of a cell.
_HALVINGS = 20


class ImplicitField(GridField):
    """Reading V: the value is the distance."""

    rule = "kim"

    def __init__(self, name, artifact):
        super().__init__(name, artifact)
        self.slopes = slopes(self.values)

    def _interpolate(self, points):
        position = self.axes.position(points)
        normal = normalise(trilinear(self.slopes, position))
        return self._length(points, normal, trilinear(self.values, position)[:, 0]), normal

    def _value(self, points):
        """Return the value (n,) at points (n, 3), clamped to the box."""
        return trilinear(self.values, self.axes.position(self._clamp(points)[0]))[:, 0]

    def _length(self, points, normal, value):
        """Return the spring's length (n,), negative inside; here the value itself."""
        del points, normal
        return value


class MarchedField(ImplicitField):
    """Reading R: the distance to the surface along the normal, refined by bisection."""

    refined = True

    def _length(self, points, normal, value):
        cell = 2.0 / (len(self.values) - 1)
        length, inside = value.copy(), np.flatnonzero(value < 0)
        start, along = points[inside], normal[inside]
        way = np.zeros(len(inside))
        looking = np.ones(len(inside), bool)
        # one cell per step, until each point is outside, or past the band without reaching the
        # surface
        for _ in range(int(np.ceil(2 * self.band.inside / cell)) + 2):
            way[looking] += cell
            place = start[looking] + way[looking, None] * along[looking]
            looking[looking] = self._value(place) < 0
            if not looking.any():
                break
        if self.refined:
            low, high = way - cell, way.copy()
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                outside = self._value(start + middle[:, None] * along) >= 0
                low, high = np.where(outside, low, middle), np.where(outside, middle, high)
            way = np.where(looking, way, (low + high) / 2)
        length[inside] = -way
        return length


class CellField(MarchedField):
    """Reading C: the distance to the surface along the normal, in whole cells."""

    refined = False

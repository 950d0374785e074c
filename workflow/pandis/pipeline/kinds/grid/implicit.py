"""[10]: a grid of implicit values, after Kim, Kyrikou, Desbrun & Sukhatme 2002.

The force points along the gradient at the probe, interpolated between central differences at the
nodes, and is that of a spring to the surface. The text was not at hand, so how the spring's length
is found is inferred. All readings are here: the value itself, taken for a distance; the
way along the gradient to where the interpolated value changes sign; the same in whole cells.
"""

import numpy as np

from pandis.pipeline.kinds.axes import slopes, trilinear
from pandis.pipeline.kinds.field import normalise
from pandis.pipeline.kinds.grid.interpolation import GridField

#: Bisections of the last cell of a march: to a millionth of it.
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
        """Return the value (n,) at points (n, 3), moved into the box."""
        return trilinear(self.values, self.axes.position(self._clamp(points)[0]))[:, 0]

    def _length(self, points, normal, value):
        """Return the spring's length (n,), negative inside; here the value itself."""
        del points, normal
        return value


class MarchedField(ImplicitField):
    """Reading R: the way along the normal to the surface, to the last digit."""

    refined = True

    def _length(self, points, normal, value):
        cell = 2.0 / (len(self.values) - 1)
        length, inside = value.copy(), np.flatnonzero(value < 0)
        start, along = points[inside], normal[inside]
        way = np.zeros(len(inside))
        looking = np.ones(len(inside), bool)
        # a step per cell, until all are outside or have left the band: no surface lies that way
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
    """Reading C: the way along the normal in whole cells."""

    refined = False

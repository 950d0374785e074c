"""A field as its ``.pandis`` file answers it: what a program loads is what is measured."""

from pandis.fields.base import Answer, Field
from pandis.geometry.frame import Frame
from pandis.native.runtime import NETWORK, SHAPE, NativeField

_UNIT = Frame((0.0, 0.0, 0.0), 1.0)


class ExportedField(Field):
    """A field answered by ``pandis.h``.

    Parameters
    ----------
    name : str
        As in the configuration.
    source : path-like or bytes
        The ``.pandis`` file, or what it holds.

    Raises
    ------
    pandis.errors.ArtifactError
        It cannot be read, or is damaged.
    """

    def __init__(self, name, source):
        self._file = NativeField(source)
        # asked in the unit frame, so that no digit is lost on the way to mesh units and back
        self._unit = self._file.placed(_UNIT)
        self.keeps_length = self._file.kind == NETWORK
        super().__init__(name, self._file.frame, self._file.bytes)

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        return self._unit.query(points)[:2]

    def query(self, points):
        """Answer with flags (unit frame)."""
        return Answer(*self._unit.query(points))

    def direction(self, points):
        """Answer distance (n,) and the direction (n, 3) before it is made a unit vector."""
        (distance, normal, _), length = self._unit.query_slopes(points)
        return distance, normal * length[:, None]

    def distance_and_normal(self, points):
        """Answer in mesh units, as a program would."""
        if self._file is None:
            return super().distance_and_normal(points)
        return self._file.distance_and_normal(points)

    def placed(self, factor, offset):
        """Return the field as it would be, had its mesh come in other units and elsewhere."""
        moved = super().placed(factor, offset)
        # a closed form is a formula around the origin: elsewhere it is asked through its frame
        formula = self._file is None or self._file.kind == SHAPE
        moved._file = None if formula else self._file.placed(moved.frame)
        return moved

"""A field queried through its ``.pandis`` file, so that measurements use what programs load."""

from pandis.base.frame import UNIT
from pandis.pipeline.kinds.field import Answer, Field
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import NETWORK, SHAPE


class ExportedField(Field):
    """A field that is queried through ``pandis.h``.

    Parameters
    ----------
    name : str
        As in the configuration.
    source : path-like, bytes or pandis.runtime.field.NativeField
        The ``.pandis`` file, its contents, or the opened file.

    Raises
    ------
    pandis.base.errors.ArtifactError
        The file cannot be read, or is damaged.
    """

    def __init__(self, name, source):
        self.file = source if isinstance(source, NativeField) else NativeField(source)
        self.keeps_length = self.file.kind == NETWORK
        #: A closed form is a formula in mesh units. All other fields store unit-frame numbers. They
        #: are queried in the unit frame, so that no conversion to mesh units and back loses digits.
        self._is_formula = self.file.kind == SHAPE
        self._unit = None if self._is_formula else self.file.placed(UNIT)
        super().__init__(name, self.file.frame, self.file.bytes)

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        return self.query(points)[:2]

    def query(self, points):
        """Return the `Answer` at points (n, 3), with flags (unit frame)."""
        if not self._is_formula:
            return Answer(*self._unit.query(points))
        home = self.file.frame
        distance, normal, flag = self.file.query(home.to_mesh(points))
        return Answer(distance * home.scale, normal, flag)

    def clear(self, points):
        """Return the radii (n,) of empty balls around points (n, 3): see `NativeField.clear`."""
        return self._unit.clear(points)

    def direction(self, points):
        """Return distance (n,) and direction (n, 3), not normalised, at points (unit frame)."""
        (distance, normal, _), length = self._unit.query_slopes(points)
        return distance, normal * length[:, None]

    def distance_and_normal(self, points):
        """Return a program's answers in mesh units; a closed form is queried through its frame."""
        answering = super() if self._is_formula else self.file
        return answering.distance_and_normal(points)

    def placed(self, factor, offset):
        """Return the field as if its mesh had other units and another position."""
        moved = super().placed(factor, offset)
        if not self._is_formula:
            moved.file = self.file.placed(moved.frame)
        return moved

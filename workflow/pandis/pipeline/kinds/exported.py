"""A field as its ``.pandis`` file answers it: what a program loads is what is measured."""

from pandis.base.frame import Frame
from pandis.pipeline.kinds.field import Answer, Field
from pandis.runtime.field import NETWORK, SHAPE, NativeField

_UNIT = Frame((0.0, 0.0, 0.0), 1.0)


class ExportedField(Field):
    """A field answered by ``pandis.h``.

    Parameters
    ----------
    name : str
        As in the configuration.
    source : path-like, bytes or pandis.runtime.field.NativeField
        The ``.pandis`` file, its contents, or the opened file.

    Raises
    ------
    pandis.base.errors.ArtifactError
        It cannot be read, or is damaged.
    """

    def __init__(self, name, source):
        self.file = source if isinstance(source, NativeField) else NativeField(source)
        self.keeps_length = self.file.kind == NETWORK
        #: A closed form is a formula in mesh units. All others store unit-frame numbers and are
        #: queried there, so that no digit is lost on the way to mesh units and back.
        self._is_formula = self.file.kind == SHAPE
        self._unit = None if self._is_formula else self.file.placed(_UNIT)
        super().__init__(name, self.file.frame, self.file.bytes)

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        return self.query(points)[:2]

    def query(self, points):
        """Answer with flags (unit frame)."""
        if not self._is_formula:
            return Answer(*self._unit.query(points))
        home = self.file.frame
        distance, normal, flag = self.file.query(home.to_mesh(points))
        return Answer(distance * home.scale, normal, flag)

    def clear(self, points):
        """Return the radii (n,) around points (n, 3) without surface: see `NativeField.clear`."""
        return self._unit.clear(points)

    def direction(self, points):
        """Answer distance (n,) and direction (n, 3), not normalised."""
        (distance, normal, _), length = self._unit.query_slopes(points)
        return distance, normal * length[:, None]

    def distance_and_normal(self, points):
        """Answer in mesh units as a program would, but a closed form through its frame."""
        answering = super() if self._is_formula else self.file
        return answering.distance_and_normal(points)

    def placed(self, factor, offset):
        """Return the field as if its mesh had come in other units and elsewhere."""
        moved = super().placed(factor, offset)
        if not self._is_formula:
            moved.file = self.file.placed(moved.frame)
        return moved

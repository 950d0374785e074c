"""Exact meshes whose vertices move, for one thread; see `handover` for two threads."""

import numpy as np

from pandis.runtime.field import ArrayLike, NativeField
from pandis.runtime.field.points import as_rows


class MovingField(NativeField):
    """An exact mesh with movable vertices; answers are those of a field of the current shape.

    Parameters
    ----------
    field : NativeField
        Field of kind MESH. Its faces are shared; it is not changed.
    """

    _NO_SHAPE = "a vertex is not finite, or too far away: the old shape stays"

    def __init__(self, field: NativeField) -> None:
        room = field._library.pandis_refit_room(field._field)
        if not room:
            raise ValueError(f"{field.path}: only an exact mesh has movable vertices")
        self._library, self.path, self.frame = field._library, field.path, field.frame
        self._begin(field)
        self._open(room)

    def __copy__(self):
        raise TypeError("a moving mesh cannot be copied: make another one with moving()")

    def __deepcopy__(self, memory):
        return self.__copy__()

    def _open(self, room):
        """Allocate ``room`` bytes for one shape, and start with the lender's shape."""
        self._room = np.empty(room // 8)
        lender = self._lender._field
        address, size = self._room.ctypes.data, self._room.nbytes
        self._library.pandis_refit_open(self._field, lender, address, size)

    def refit(self, vertices: ArrayLike) -> float:
        """Move the vertices.

        Parameters
        ----------
        vertices : ndarray, shape (V, 3), mesh units
            In the order of ``mesh.zarr.zip``. The frame does not change: queries outside its
            box are answered, but flagged as bounds.

        Returns
        -------
        float
            Duration, s.

        Raises
        ------
        ValueError
            The number of vertices is wrong, or a coordinate is not finite or too large. The old
            shape is kept.
        """
        vertices = self._checked(vertices)
        taken = self._library.runtime_refit_time(self._field, vertices.ctypes.data)
        if taken < 0:
            raise ValueError(self._NO_SHAPE)
        return taken

    def _checked(self, vertices):
        vertices, count = as_rows(vertices), self._library.pandis_vertex_count(self._lender._field)
        if len(vertices) != count:
            raise ValueError(f"the mesh has {count:,} vertices, not {len(vertices):,}")
        return vertices

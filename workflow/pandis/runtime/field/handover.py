"""Meshes that one thread moves while another queries them; neither waits: ``pandis_handover``."""

import ctypes
import time

import numpy as np

from pandis.runtime.field import ArrayLike
from pandis.runtime.field.moving import MovingField


class SharedField(MovingField):
    """An exact mesh that one thread moves while another queries its newest complete shape.

    Only one thread may query and call `take`, and only one other may call `refit`.

    Parameters
    ----------
    field : NativeField
        Field of kind MESH. Its faces are shared; it is not changed.
    """

    def _open(self, room):
        """Allocate memory for three shapes; ``pandis.h`` computes its size."""
        room = self._library.pandis_handover_room(self._lender._field)
        self._room = np.empty(room // 8)
        self._handover = ctypes.create_string_buffer(self._library.runtime_handover_bytes())
        lender = self._lender._field
        address, size = self._room.ctypes.data, self._room.nbytes
        self._library.pandis_handover_open(self._handover, lender, address, size)
        self.take()

    def refit(self, vertices: ArrayLike) -> float:
        """Move the vertices (V, 3), as `MovingField.refit` does, and hand the shape over.

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
        start, vertices = time.perf_counter(), self._checked(vertices)
        if self._library.pandis_handover_refit(self._handover, vertices.ctypes.data, len(vertices)):
            raise ValueError(self._NO_SHAPE)
        return time.perf_counter() - start

    def take(self) -> bool:
        """Switch to the newest complete shape; return whether it is a new one."""
        return bool(self._library.pandis_handover_take(self._handover, self._field))

"""Meshes that one thread moves while another asks, and neither waits: ``pandis_handover``."""

import ctypes
import time

import numpy as np

from pandis.runtime.field import ArrayLike
from pandis.runtime.field.moving import MovingField


class SharedField(MovingField):
    """An exact mesh whose vertices one thread moves, while another asks the newest whole shape.

    Queries, `take` among them, belong to one thread, `refit` to one other.

    Parameters
    ----------
    field : NativeField
        Field of kind MESH; it lends its faces, and stays as it is.
    """

    def _open(self, room):
        """Take room for three shapes, which the header counts."""
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
            The seconds that it took.

        Raises
        ------
        ValueError
            There are more or fewer, or one is no finite number; the old shape stays.
        """
        start, vertices = time.perf_counter(), self._checked(vertices)
        if self._library.pandis_handover_refit(self._handover, vertices.ctypes.data, len(vertices)):
            raise ValueError(self._NO_SHAPE)
        return time.perf_counter() - start

    def take(self) -> bool:
        """Ask the newest whole shape from now on; tell whether it is another one than before."""
        return bool(self._library.pandis_handover_take(self._handover, self._field))

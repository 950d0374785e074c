"""Meshes that one thread moves while another asks, and neither waits: ``pandis_handover``."""

import ctypes

import numpy as np

from pandis.native.runtime import MovingField, library


class SharedField(MovingField):
    """An exact mesh whose vertices one thread moves, while another asks the newest whole shape.

    Queries, `take` among them, belong to one thread, `refit` to one other.

    Parameters
    ----------
    field : NativeField
        Of kind MESH; it lends its faces, and stays as it is.
    """

    def __init__(self, field):
        super().__init__(field)
        lib = library()
        pointer = ctypes.c_void_p
        lib.runtime_handover_bytes.restype = lib.pandis_handover_room.restype = ctypes.c_size_t
        lib.pandis_handover_room.argtypes = [pointer]
        lib.pandis_handover_open.argtypes = [pointer] * 3
        lib.pandis_handover_refit.argtypes = lib.pandis_handover_take.argtypes = [pointer] * 2
        self._handover = ctypes.create_string_buffer(lib.runtime_handover_bytes())
        self._room = np.empty(lib.pandis_handover_room(field._field) // 8)
        lib.pandis_handover_open(self._handover, field._field, self._room.ctypes.data)
        self.take()

    def refit(self, vertices):
        """Move the vertices (V, 3), as `MovingField.refit` does, and hand the shape over.

        Raises
        ------
        ValueError
            There are more or fewer, or one is no finite number; the old shape stays.
        """
        vertices = self._checked(vertices)
        if self._library.pandis_handover_refit(self._handover, vertices.ctypes.data):
            raise ValueError(self._NO_SHAPE)

    def take(self):
        """Ask the newest whole shape from now on; tell whether it is another one than before."""
        return bool(self._library.pandis_handover_take(self._handover, self._field))

"""The library compiled from ``field.c``, with its functions' types declared."""

import ctypes
from functools import cache
from pathlib import Path

from pandis.engine.compiler import load

#: C source of the library.
SOURCE = Path(__file__).with_name("field.c")


@cache
def library():
    """Return the compiled library."""
    return declared(load(SOURCE))


def declared(lib):
    """Declare the function types of a library compiled from SOURCE, and return it."""
    pointer, size, f64 = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double
    lib.runtime_field_bytes.restype = size
    lib.pandis_open.argtypes = [pointer, pointer, size]
    lib.pandis_open_file.argtypes = [pointer, ctypes.c_char_p]
    lib.pandis_close.argtypes = [pointer]
    lib.pandis_error_text.restype = ctypes.c_char_p
    lib.pandis_error_text.argtypes = [ctypes.c_int]
    lib.pandis_field_kind.argtypes = [pointer]
    lib.runtime_query.argtypes = [pointer, pointer, size, pointer, pointer, pointer, pointer]
    lib.runtime_place.argtypes = [pointer, pointer, pointer]
    lib.runtime_bytes.restype, lib.runtime_bytes.argtypes = size, [pointer]
    lib.runtime_forces.argtypes = [pointer, pointer, size, f64, pointer, pointer]
    for name in ("clear", "faces", "regions"):
        getattr(lib, f"runtime_{name}").argtypes = [pointer, pointer, size, pointer]
    lib.pandis_region.restype, lib.pandis_region.argtypes = ctypes.c_char_p, [pointer, ctypes.c_int]
    lib.pandis_refit_room.restype, lib.pandis_refit_room.argtypes = size, [pointer]
    lib.pandis_refit_open.argtypes = [pointer, pointer, pointer, size]
    lib.pandis_refit.argtypes = [pointer, pointer, size]
    lib.runtime_handover_bytes.restype = size
    lib.pandis_bounds.argtypes = [pointer, pointer, pointer]
    lib.pandis_handover_room.restype, lib.pandis_handover_room.argtypes = size, [pointer]
    lib.pandis_handover_open.argtypes = [pointer, pointer, pointer, size]
    lib.pandis_handover_refit.argtypes = [pointer, pointer, size]
    lib.pandis_handover_take.argtypes = [pointer, pointer]
    lib.pandis_distance.argtypes = [pointer, pointer, pointer]
    lib.pandis_vertex_count.restype, lib.pandis_vertex_count.argtypes = size, [pointer]
    lib.runtime_refit_time.restype, lib.runtime_refit_time.argtypes = f64, [pointer, pointer]
    lib.runtime_frame.argtypes = [pointer, pointer]
    lib.runtime_derivatives.argtypes = [pointer, pointer, size, pointer, pointer]
    lib.runtime_within.argtypes = [pointer, pointer, size, f64, *[pointer] * 4]
    lib.runtime_time.argtypes = [pointer, pointer, size, size, f64, pointer, pointer, size]
    return lib

"""Checks that C structures and their Python mirrors have the same layout."""

import ctypes

from pandis.base.errors import PandisError


class _Entry(ctypes.Structure):
    """Mirrors ``layout_entry`` of ``layout.h``."""

    _fields_ = (
        ("type", ctypes.c_char_p),
        ("field", ctypes.c_char_p),
        ("at", ctypes.c_size_t),
        ("size", ctypes.c_size_t),
    )


def compare_layouts(entries, mirrors):
    """Compare structures with the layouts that a compiled library reports.

    Parameters
    ----------
    entries : callable
        Library function that returns an array of ``layout_entry``.
    mirrors : dict of str to ctypes.Structure
        Mirrors by C type name.

    Raises
    ------
    PandisError
        A field's offset or size differs, or the field is missing on one side, because only one
        side was changed.
    """
    entries.restype = ctypes.POINTER(_Entry)
    native, first = {}, entries()
    for k in range(1 << 16):
        entry = first[k]
        if not entry.type:
            break
        native[entry.type.decode(), (entry.field or b"").decode()] = entry.at, entry.size
    mirrored = {}
    for name, mirror in mirrors.items():
        mirrored[name, ""] = 0, ctypes.sizeof(mirror)
        for field, *_ in mirror._fields_:
            place = getattr(mirror, field)
            mirrored[name, field] = place.offset, place.size
    for key in native.keys() | mirrored.keys():
        if native.get(key) != mirrored.get(key):
            there, here = (side.get(key, "nothing") for side in (native, mirrored))
            raise PandisError(
                f"{'.'.join(filter(None, key))}: offset and size are {there} in C, and {here} in "
                "Python; change both"
            )

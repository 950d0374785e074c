"""The bytes of ``.pandis`` files: what docs/format.md describes."""

import json
import struct
import zlib
from pathlib import Path

import numpy as np

from pandis.errors import ArtifactError
from pandis.native.runtime import NativeField

_MAGIC, _ORDER = b"PANDIS\r\n", 0x0A0B0C0D
_HEADER, _SECTION, _ALIGN = 256, 24, 64
_WHOLES, _REALS = 14, 16


def pack(kind, frame, wholes, reals, sections, provenance, version=1):
    """Return the bytes of a ``.pandis`` file.

    Parameters
    ----------
    kind : int
    frame : pandis.geometry.frame.Frame
    wholes, reals : sequence of int, of float
        The numbers of the header, at most 14 and 16.
    sections : dict of str to ndarray or bytes
        By names of four letters.
    provenance : dict
        Kept as JSON in a section of its own.
    version : {1, 2, 3, 4}
        Of the format: the first that knows what the file holds, so that older readers of
        ``pandis.h`` take whatever they can answer.
    """
    sections = sections | {"PROV": json.dumps(provenance, sort_keys=True).encode()}
    parts = {
        name: part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()
        for name, part in sections.items()
    }
    at, table, body = _HEADER + _SECTION * len(parts), [], []
    for name, part in parts.items():
        start = -(-at // _ALIGN) * _ALIGN
        table.append(struct.pack("<4sIQQ", name.encode(), 0, start, len(part)))
        body += [bytes(start - at), part]
        at = start + len(part)
    body.append(bytes(-at % 8))
    numbers = [*wholes, *[0] * (_WHOLES - len(wholes))]
    header = struct.pack("<II3dd14i", kind, len(parts), *frame.centre, frame.scale, *numbers)
    header += struct.pack("<16d", *reals, *[0.0] * (_REALS - len(reals)))
    pieces, checksum = [header, *table, *body], 0
    for piece in pieces:
        checksum = zlib.crc32(piece, checksum)
    size = 32 + sum(map(len, pieces))
    start = struct.pack("<IIQIi", _ORDER, version, size, checksum, 0)
    return b"".join([_MAGIC, start, *pieces])


def read_provenance(path):
    """Return the provenance in a ``.pandis`` file.

    Raises
    ------
    ArtifactError
        It is no such file, or damaged.
    """
    NativeField(path)  # checks all of it
    data = Path(path).read_bytes()
    (count,) = struct.unpack_from("<I", data, 36)
    for index in range(count):
        name, _, start, size = struct.unpack_from("<4sIQQ", data, _HEADER + _SECTION * index)
        if name == b"PROV":
            return json.loads(data[start : start + size])
    raise ArtifactError(f"{path}: it has no provenance")

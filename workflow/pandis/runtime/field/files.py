"""Reads and writes the bytes of ``.pandis`` files: see docs/format.md."""

import json
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import ArtifactError
from pandis.runtime.field import NativeField

_MAGIC, _ORDER = b"PANDIS\r\n", 0x0A0B0C0D
_HEADER, _SECTION, _ALIGN = 256, 24, 64
_WHOLES, _REALS = 14, 16


class Parts(NamedTuple):
    """The contents of a file that depend on the kind of its field.

    Attributes
    ----------
    kind : int
        Number of the kind.
    wholes, reals : sequence of int, of float
        Numbers in the header: at most 14 integers and 16 reals.
    sections : dict of str to ndarray or bytes
        Sections by name; a name has four characters.
    """

    kind: int
    wholes: Sequence[int]
    reals: Sequence[float]
    sections: dict

    def add(self, sections):
        """Return the parts with additional sections."""
        return self._replace(sections=self.sections | sections)


def pack(frame, parts, provenance, *, version=1):
    """Return the bytes of a ``.pandis`` file.

    Parameters
    ----------
    frame : pandis.base.frame.Frame
    parts : Parts
    provenance : dict
        Stored as JSON in section PROV.
    version : {1, 2, 3, 4}
        Version of the format. Write the lowest that supports the content, so that older versions of
        ``pandis.h`` can read it.
    """
    kind, wholes, reals, sections = parts.add(
        {"PROV": json.dumps(provenance, sort_keys=True).encode()}
    )
    contents = {
        name: part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()
        for name, part in sections.items()
    }
    at, table, body = _HEADER + _SECTION * len(contents), [], []
    for name, part in contents.items():
        start = -(-at // _ALIGN) * _ALIGN
        table.append(struct.pack("<4sIQQ", name.encode(), 0, start, len(part)))
        body += [bytes(start - at), part]
        at = start + len(part)
    body.append(bytes(-at % 8))
    numbers = [*wholes, *[0] * (_WHOLES - len(wholes))]
    header = struct.pack("<II3dd14i", kind, len(contents), *frame.centre, frame.scale, *numbers)
    header += struct.pack("<16d", *reals, *[0.0] * (_REALS - len(reals)))
    pieces, checksum = [header, *table, *body], 0
    for piece in pieces:
        checksum = zlib.crc32(piece, checksum)
    size = 32 + sum(map(len, pieces))
    start = struct.pack("<IIQIi", _ORDER, version, size, checksum, 0)
    return b"".join([_MAGIC, start, *pieces])


class Contents(NamedTuple):
    """Header and sections of a ``.pandis`` file.

    Attributes
    ----------
    field : pandis.runtime.field.NativeField
    version : int
        Version of the format.
    wholes, reals : tuple of int, of float
        Their meaning depends on the kind: see docs/format.md.
    sections : dict of str to memoryview
    """

    field: NativeField
    version: int
    wholes: tuple[int, ...]
    reals: tuple[float, ...]
    sections: dict[str, memoryview]

    @property
    def provenance(self):
        """How the field was made; None if the file has no provenance.

        Raises
        ------
        ArtifactError
            The provenance is not a JSON object.
        """
        part = self.sections.get("PROV")
        if part is None:
            return None
        try:
            content = json.loads(bytes(part))
        except ValueError as error:  # includes invalid UTF-8
            raise ArtifactError(
                f"{self.field.path}: its provenance is not JSON: {error}"
            ) from error
        if not isinstance(content, dict):
            raise ArtifactError(f"{self.field.path}: its provenance is not a JSON object")
        return content


def read_contents(path):
    """Return the `Contents` of a ``.pandis`` file.

    Raises
    ------
    ArtifactError
        It is not a ``.pandis`` file, or is damaged.
    """
    field = NativeField(path)  # checks the whole file
    data = memoryview(Path(path).read_bytes())
    (version,), (count,) = struct.unpack_from("<I", data, 12), struct.unpack_from("<I", data, 36)
    sections = {}
    for index in range(count):
        name, _, start, size = struct.unpack_from("<4sIQQ", data, _HEADER + _SECTION * index)
        sections[name.decode("latin-1")] = data[start : start + size]
    wholes = struct.unpack_from(f"<{_WHOLES}i", data, 72)
    reals = struct.unpack_from(f"<{_REALS}d", data, 128)
    return Contents(field, version, wholes, reals, sections)


def read_provenance(path):
    """Return the provenance in a ``.pandis`` file.

    Raises
    ------
    ArtifactError
        It is not a ``.pandis`` file, is damaged or has no provenance.
    """
    provenance = read_contents(path).provenance
    if provenance is None:
        raise ArtifactError(f"{path}: it has no provenance")
    return provenance

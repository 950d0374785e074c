"""Fields as ``pandis.h`` answers them: the binding of ``runtime.c``, and its files."""

import ctypes
import json
import struct
import zlib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.errors import ArtifactError
from pandis.geometry.frame import Frame
from pandis.native.compiler import load as load_library

#: What a file can hold; numbers of docs/format.md.
NETWORK, GRID, SPLINE, MESH, SHAPE = 1, 2, 3, 4, 5
#: How a grid is interpolated.
RULES = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
#: Closed forms, in the order of their numbers.
SHAPES = ("sphere", "torus", "box", "capsule")
#: Bytes written between queries with cold caches: more than the caches of a core hold.
CACHES = 1 << 26
_MAGIC, _ORDER = b"PANDIS\r\n", 0x0A0B0C0D
_HEADER, _SECTION, _ALIGN = 256, 24, 64
_WHOLES, _REALS = 14, 16


class NativeAnswer(NamedTuple):
    """Distances (n,), normals (n, 3) in mesh units, and flags (n,): `pandis.fields.base.Answer`."""

    distance: np.ndarray
    normal: np.ndarray
    flag: np.ndarray


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load_library(Path(__file__).with_name("runtime.c"))
    pointer, size, f64 = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double
    lib.runtime_field_bytes.restype = size
    lib.pandis_open.argtypes = [pointer, pointer, size]
    lib.pandis_open_file.argtypes = [pointer, ctypes.c_char_p]
    lib.pandis_close.argtypes = [pointer]
    lib.pandis_error.restype, lib.pandis_error.argtypes = ctypes.c_char_p, [ctypes.c_int]
    lib.pandis_query_many.argtypes = [pointer, pointer, size, pointer, pointer, pointer]
    lib.runtime_forces.argtypes = [pointer, pointer, size, f64, pointer, pointer]
    lib.runtime_frame.argtypes = [pointer, pointer]
    lib.runtime_time.argtypes = [pointer, pointer, size, size, pointer, pointer, size]
    return lib


class NativeField:
    """A field in a ``.pandis`` file, answered by ``pandis.h``.

    Its ``frame`` is the `pandis.geometry.frame.Frame` that it was made in.

    Parameters
    ----------
    source : path-like or bytes
        The file, or what it holds.

    Raises
    ------
    ArtifactError
        It cannot be read, is damaged, or holds what does not fit together.
    """

    def __init__(self, source):
        self._library = library()
        self._field = ctypes.create_string_buffer(self._library.runtime_field_bytes())
        if isinstance(source, bytes):
            self.path, self._held = Path("field.pandis"), np.frombuffer(source, np.uint8).copy()
            size = len(self._held)
            error = self._library.pandis_open(self._field, self._held.ctypes.data, size)
        else:
            self.path = Path(source)
            error = self._library.pandis_open_file(self._field, str(source).encode())
        if error:
            self._field, why = None, self._library.pandis_error(error).decode()
            raise ArtifactError(f"{self.path}: {why}")
        numbers = (ctypes.c_double * 4)()
        self._library.runtime_frame(self._field, numbers)
        self.frame = Frame(tuple(numbers[:3]), numbers[3])

    def __del__(self):
        if getattr(self, "_field", None):
            self._library.pandis_close(self._field)

    @property
    def address(self):
        """Where the opened field lies, for other C code."""
        return ctypes.addressof(self._field)

    def query(self, points):
        """Answer distances (n,), normals (n, 3) and flags (n,) at points (n, 3), mesh units."""
        points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        answer = NativeAnswer(
            np.empty(len(points)), np.empty((len(points), 3)), np.empty(len(points), np.uint8)
        )
        columns = (column.ctypes.data for column in answer)
        self._library.pandis_query_many(self._field, points.ctypes.data, len(points), *columns)
        return answer

    def distance_and_normal(self, points):
        """Answer distances (n,) and unit normals (n, 3) at points (n, 3), all in mesh units."""
        return self.query(points)[:2]

    def force(self, points, k=1.0):
        """Return the penalty forces (n, 3) at points (n, 3), mesh units.

        Parameters
        ----------
        k : float
            Stiffness, force per mesh unit.
        """
        points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        forces, flags = np.empty_like(points), np.empty(len(points), np.uint8)
        self._library.runtime_forces(
            self._field, points.ctypes.data, len(points), k, forces.ctypes.data, flags.ctypes.data
        )
        return forces

    def time(self, points, queries, cold=False):
        """Return the seconds (queries,) of single queries at points (n, 3) in turn.

        ``cold``: before each of them other work empties the caches.
        """
        points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        if not len(points) or queries < 1:
            raise ValueError("at least one point and one query are needed")
        taken, other = np.empty(queries), np.zeros(CACHES if cold else 0, np.uint8)
        self._library.runtime_time(
            self._field, points.ctypes.data, len(points), queries, taken.ctypes.data,
            other.ctypes.data, len(other),
        )  # fmt: skip
        return taken


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
    version : {1, 2}
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
    rest = b"".join([header, *table, *body])
    size = 32 + len(rest)
    start = struct.pack("<IIQIi", _ORDER, version, size, zlib.crc32(rest), 0)
    return _MAGIC + start + rest


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

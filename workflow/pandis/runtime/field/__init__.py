"""Fields evaluated by ``pandis.h``: the binding of ``field.c``."""

import ctypes
import weakref
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pandis.base.errors import ArtifactError
from pandis.base.files import write_new
from pandis.base.frame import Frame
from pandis.engine.threads import SMALL, in_threads
from pandis.runtime.field.binding import library
from pandis.runtime.field.constants import BEYOND, CACHES, CUT, GRID, NETWORK
from pandis.runtime.field.pickles import reopened, stamp
from pandis.runtime.field.points import as_rows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pandis.runtime.field import moving
else:
    ArrayLike = object  # NumPy accepts more than numpy.typing.ArrayLike allows

#: Arrays of C doubles.
Floats = NDArray[np.float64]
#: Real number; includes int, which run-time type checkers do not accept as float.
Number = float | int
#: Sources of a field: a path, or a file's bytes.
Source = str | PathLike[str] | bytes
#: Fewer network queries than this are not worth a second thread.
_FEW = 64


class NativeAnswer(NamedTuple):
    """Distances (n,) in mesh units, unit normals (n, 3) and flags (n,): `Answer`."""

    distance: Floats
    normal: Floats
    flag: NDArray[np.uint8]


class NativeField:
    """A field in a ``.pandis`` file, evaluated by ``pandis.h``.

    Use a ``with`` block, or `close`, to release the file early. Fields are immutable, so a copy is
    the field itself. A pickle stores the file's path, and fails to load if the file has changed
    since. A field made from bytes is pickled with them.

    Parameters
    ----------
    source : path-like or bytes
        The file, or its bytes.

    Raises
    ------
    ArtifactError
        The file cannot be read, is damaged or is inconsistent.

    Attributes
    ----------
    path : Path
        Path of the file; for a field made from bytes, a name for messages.
    frame : pandis.base.frame.Frame
        The unit frame of the field's mesh.
    """

    def __init__(self, source: Source) -> None:
        self._library = library()
        self._begin(None)
        if isinstance(source, bytes):
            self.path, self._bytes = Path("field.pandis"), np.frombuffer(source, np.uint8)
            if self._bytes.ctypes.data % 8:  # copy only if needed: a large mesh takes a gigabyte
                self._bytes = self._bytes.copy()
            size = len(self._bytes)
            error = self._library.pandis_open(self._field, self._bytes.ctypes.data, size)
        else:
            self.path = Path(source)
            self._bytes, self._stamp = None, stamp(self.path)
            error = self._library.pandis_open_file(self._field, str(source).encode())
        if error:
            self._opened, why = None, self._library.pandis_error_text(error).decode()
            raise ArtifactError(f"{self.path}: {why}")
        numbers = (ctypes.c_double * 4)()
        self._library.runtime_frame(self._field, numbers)
        self.frame = Frame(tuple(numbers[:3]), numbers[3])

    def _begin(self, lender):
        """Allocate a C field, which shares the bytes of ``lender`` unless that is None."""
        self._opened = ctypes.create_string_buffer(self._library.runtime_field_bytes())
        self._closed, self._lender, self._borrowers = False, lender, weakref.WeakSet()
        if lender is not None:
            lender._borrowers.add(self)

    @property
    def _field(self):
        if self._closed:
            raise ValueError(f"{self.path}: this field has been closed")
        return self._opened

    def close(self) -> None:
        """Release the file, and close fields made by `placed` and `moving`.

        A closed field raises ValueError on use, and has no answer in scenes that contain it. No
        other thread may be using it.
        """
        for borrower in list(self._borrowers):
            borrower.close()
        if not self._closed and self._opened is not None:
            self._library.pandis_close(self._opened)
        self._closed = True

    def __enter__(self) -> "NativeField":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self):
        if getattr(self, "_opened", None):
            self.close()

    def __repr__(self) -> str:
        if self._closed:
            return f"<{type(self).__name__} {self.path}, closed>"
        kind = ("network", "grid", "spline", "mesh", "shape", "compact mesh")[self.kind - 1]
        return f"<{type(self).__name__} {self.path}: {kind}, {self.bytes:,} bytes>"

    def __copy__(self) -> "NativeField":
        return self

    def __deepcopy__(self, memory: object) -> "NativeField":
        return self

    def __reduce__(self):
        if self._lender is not None:
            raise TypeError(f"{self.path}: cannot be pickled; pickle the field it was made from")
        if self._bytes is not None:
            return NativeField, (self._bytes.tobytes(),)
        return reopened, (self.path.absolute(), self._stamp)

    def save(self, path: str | PathLike[str], force: bool = False) -> None:
        """Write the field's ``.pandis`` file.

        Raises
        ------
        PandisError
            The file exists (and not ``force``), or cannot be written.
        """
        if self._lender is not None:
            raise TypeError(f"{self.path}: save the field that this one was made from")
        data = self.path.read_bytes() if self._bytes is None else self._bytes.tobytes()
        write_new(path, data, force=force)

    def placed(self, frame: Frame) -> "NativeField":
        """Return this field as if its mesh had other units and another position.

        Parameters
        ----------
        frame : pandis.base.frame.Frame
            The new unit frame. Not valid for closed forms, which are formulas in mesh units around
            the origin.
        """
        other = object.__new__(NativeField)
        other._library, other.path, other.frame = self._library, self.path, frame
        other._begin(self)
        numbers = (ctypes.c_double * 4)(*frame.centre, frame.scale)
        self._library.runtime_place(other._field, self._field, numbers)
        return other

    def moving(self) -> "moving.MovingField":
        """Return a `MovingField` of this field, which must be an exact mesh.

        Raises
        ------
        ValueError
            The field is of another kind, which has no movable vertices.
        """
        from pandis.runtime.field.moving import MovingField

        return MovingField(self)

    @property
    def kind(self) -> int:
        """NETWORK, GRID, SPLINE, MESH, SHAPE or COMPACT."""
        return self._library.pandis_field_kind(self._field)

    @property
    def bytes(self) -> int:
        """Number of bytes from which answers are computed.

        This excludes the sections on trust, provenance, original faces and regions.
        """
        return self._library.runtime_bytes(self._field)

    @property
    def has_distance(self) -> bool:
        """Whether there are distances outside; false only for grids of forces, whose slope is 0."""
        somewhere = self.frame.to_mesh([[0.31, -0.27, 0.19]])  # at the centre the slope may be 0
        return self.kind != GRID or bool(self.query_slopes(somewhere)[1][0] > 0)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The lowest and highest corner (3,) of a box around the surface, mesh units."""
        low, high = np.empty(3), np.empty(3)
        self._library.pandis_bounds(self._field, low.ctypes.data, high.ctypes.data)
        return low, high

    @property
    def address(self) -> int:
        """Address of the C field, for other C code."""
        return ctypes.addressof(self._field)

    def query(self, points: ArrayLike) -> NativeAnswer:
        """Return distances (n,), normals (n, 3) and flags (n,) at points (n, 3), mesh units."""
        return self._query(points)[0]

    def query_slopes(self, points: ArrayLike) -> tuple[NativeAnswer, Floats]:
        """Return `query`'s result and the length (n,) of each normal before normalisation."""
        return self._query(points, slopes=True)

    def clear(self, points: ArrayLike) -> Floats:
        """Return the radii (n,) of surface-free balls around points (n, 3), mesh units.

        Where the search was cut short, a radius is a proven lower bound of the distance; elsewhere
        it is the absolute distance.
        """
        points = as_rows(points)
        clear = np.empty(len(points))
        self._library.runtime_clear(self._field, points.ctypes.data, len(points), clear.ctypes.data)
        return clear

    def faces(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the faces (n,) of ``mesh.zarr.zip`` that are closest to points (n, 3).

        Available for exact meshes, and for compact ones with ``export.original_faces``; -1 for
        other fields and where there is no answer.
        """
        return self._numbers(self._library.runtime_faces, points)

    def regions(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the regions (n,) of the surface closest to points (n, 3); -1 where unknown.

        Known for exact and compact meshes whose source file names materials.
        """
        return self._numbers(self._library.runtime_regions, points)

    def _numbers(self, ask, points):
        points = as_rows(points)
        numbers = np.empty(len(points), np.int32)
        ask(self._field, points.ctypes.data, len(points), numbers.ctypes.data)
        return numbers

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions, in order: the materials named in the mesh file."""
        names = []
        while (name := self._library.pandis_region(self._field, len(names))) is not None:
            names.append(name.decode())
        return tuple(names)

    def query_within(self, points: ArrayLike, reach: Number) -> tuple[NativeAnswer, Floats]:
        """Query points (n, 3); answer only where a surface is within ``reach``, mesh units.

        Returns
        -------
        answer : NativeAnswer
            As from `query`; NaN, with flag 4, where no surface is within reach. Answers with flag
            `CUT` are kept: the surface may be nearer than their distance.
        clear : ndarray, shape (n,)
            Lower bound of the distance to the surface, mesh units.
        """
        if not reach >= 0:
            raise ValueError(f"a reach must be 0 or more, not {reach}")
        points = as_rows(points)
        count = len(points)
        answer = NativeAnswer(np.empty(count), np.empty((count, 3)), np.empty(count, np.uint8))
        clear = np.empty(count)
        columns = [column.ctypes.data for column in (*answer, clear)]
        self._library.runtime_within(self._field, points.ctypes.data, count, reach, *columns)
        beyond = (np.abs(answer.distance) > reach) & (answer.flag != CUT)
        answer.distance[beyond], answer.normal[beyond], answer.flag[beyond] = np.nan, np.nan, BEYOND
        return answer, clear

    def _query(self, points, slopes=False):
        points = as_rows(points)
        count = len(points)
        answer = NativeAnswer(np.empty(count), np.empty((count, 3)), np.empty(count, np.uint8))
        lengths = np.empty(count) if slopes else None
        starts = [column.ctypes.data for column in (points, *answer)]

        def part(low, high):
            x, d, n, flag = (at + low * k for at, k in zip(starts, (24, 8, 24, 1), strict=True))
            slope = lengths.ctypes.data + 8 * low if slopes else None
            self._library.runtime_query(self._field, x, high - low, d, n, flag, slope)

        # networks are slow enough for a second thread to pay off early
        in_threads(part, count, small=_FEW if self.kind == NETWORK else SMALL)
        return answer, lengths

    def distance_and_normal(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Return distances (n,) and unit normals (n, 3) at points (n, 3), mesh units."""
        return self.query(points)[:2]

    def gradient(self, points: ArrayLike) -> Floats:
        """Return the gradients (n, 3) of the distance at points (n, 3).

        For meshes and closed forms the gradient is the normal. For other fields its length may
        differ from 1. For the paper's network it is the derivative of the distance, not the
        direction that the network returns. NaN where there is no answer, and for grids of forces,
        which have no distance.
        """
        return self._derivatives(points)[0]

    def hessian(self, points: ArrayLike) -> Floats:
        """Return the second derivatives (n, 3, 3) of the distance at points (n, 3), per mesh unit.

        They are analytic for meshes, closed forms, splines and grids of distances. For meshes and
        closed forms, only the nearest feature counts: next to a flat face they are 0, and next to
        an edge or a corner they are those of a cylinder or a sphere around it. For networks, and
        where the flag marks a bound, they are finite differences over at most a few thousandths of
        the object. They are NaN where `gradient` is NaN.
        """
        return self._derivatives(points)[1]

    def _derivatives(self, points):
        points = as_rows(points)
        count = len(points)
        gradients, hessians = np.empty((count, 3)), np.empty((count, 3, 3))

        def part(low, high):
            where = [array[low:].ctypes.data for array in (points, gradients, hessians)]
            self._library.runtime_derivatives(self._field, where[0], high - low, *where[1:])

        in_threads(part, count, small=_FEW if self.kind == NETWORK else SMALL)
        return gradients, hessians

    def force(self, points: ArrayLike, k: Number = 1.0) -> Floats:
        """Return the penalty forces (n, 3) at points (n, 3), mesh units.

        Parameters
        ----------
        k : float
            Stiffness, force per mesh unit: finite and not negative.

        Raises
        ------
        ValueError
            ``k`` is out of range.
        """
        if not 0 <= k < np.inf:
            raise ValueError(f"k must be finite and not negative, not {k}")
        points = as_rows(points)
        forces, flags = np.empty_like(points), np.empty(len(points), np.uint8)
        self._library.runtime_forces(
            self._field, points.ctypes.data, len(points), k, forces.ctypes.data, flags.ctypes.data
        )
        return forces

    def time(
        self,
        points: ArrayLike,
        queries: int,
        cold: bool = False,
        *,
        reach: Number | None = None,
    ) -> Floats:
        """Return the durations (queries,), s, of single queries that cycle through points (n, 3).

        If ``cold``, the caches are emptied before each query. With ``reach``, queries are those of
        `query_within`.
        """
        points = as_rows(points)
        if not len(points) or queries < 1:
            raise ValueError("at least one point and one query are needed")
        taken, other = np.empty(queries), np.zeros(CACHES if cold else 0, np.uint8)
        how = -1.0 if reach is None else reach
        self._library.runtime_time(
            self._field, points.ctypes.data, len(points), queries, how, taken.ctypes.data,
            other.ctypes.data, len(other),
        )  # fmt: skip
        return taken

"""Fields as ``pandis.h`` answers them: the binding of ``field.c``."""

import ctypes
import weakref
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pandis.base.errors import ArtifactError
from pandis.base.frame import Frame
from pandis.engine.threads import SMALL, in_threads
from pandis.runtime.field.binding import library
from pandis.runtime.field.pickles import reopened, stamp
from pandis.runtime.field.points import as_rows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pandis.runtime.field import moving
else:
    ArrayLike = object  # numpy.typing.ArrayLike is narrower than what NumPy accepts

#: What a file can hold; numbers of docs/format.md.
NETWORK, GRID, SPLINE, MESH, SHAPE, COMPACT = 1, 2, 3, 4, 5, 6
#: The flags of an answer that is cut (see `pandis.h`), and of a point that no surface is near (see
#: `NativeField.query_within`).
CUT, BEYOND = 3, 4
#: How a grid is interpolated.
RULES = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
#: Closed forms, in the order of their numbers.
SHAPES = ("sphere", "torus", "box", "capsule")
#: Arrays of what C computes with.
Floats = NDArray[np.float64]
#: A number: to what checks calls while they run a whole one is no float.
Number = float | int
#: What a field is opened from.
Source = str | PathLike[str] | bytes
#: Bytes written between queries with cold caches: more than the caches of a core hold.
CACHES = 1 << 26
#: Fewer points of a network than this are not worth a second thread.
_FEW = 64


class NativeAnswer(NamedTuple):
    """Distances (n,), normals (n, 3) in mesh units, and flags (n,): `Answer`."""

    distance: Floats
    normal: Floats
    flag: NDArray[np.uint8]


class NativeField:
    """A field in a ``.pandis`` file, answered by ``pandis.h``.

    Use it in a ``with`` block, or `close` it, to let go of the file early. A copy is the field
    itself, for nothing of it changes. A pickle holds the file's path and is refused where the file
    has changed since; of a field made of bytes it holds the bytes.

    Parameters
    ----------
    source : path-like or bytes
        The file, or what it holds.

    Raises
    ------
    ArtifactError
        It cannot be read, is damaged, or holds what does not fit together.

    Attributes
    ----------
    path : Path
        Path of the file; for a field made from bytes, a name for messages.
    frame : pandis.base.frame.Frame
        The one that the field was made in.
    """

    def __init__(self, source: Source) -> None:
        self._library = library()
        self._begin(None)
        if isinstance(source, bytes):
            self.path, self._bytes = Path("field.pandis"), np.frombuffer(source, np.uint8)
            if self._bytes.ctypes.data % 8:  # hardly ever; of a large mesh a copy is a gigabyte
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
        """Make room for a field in C, which reads the bytes of another one, or its own."""
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
        """Let go of the file, also for what `placed` and `moving` have made of this field.

        Asked again, a closed field raises ValueError; scenes that hold it get no answer from it.
        No other thread may be asking it meanwhile.
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
            raise TypeError(f"{self.path}: pickle the field that this one was made of")
        if self._bytes is not None:
            return NativeField, (self._bytes.tobytes(),)
        return reopened, (self.path.absolute(), self._stamp)

    def placed(self, frame: Frame) -> "NativeField":
        """Return the field as it would be, had its mesh come in other units and at another place.

        Parameters
        ----------
        frame : pandis.base.frame.Frame
            The one that it would have been made in then. Not of a closed form, which is a formula
            in mesh units around the origin.
        """
        other = object.__new__(NativeField)
        other._library, other.path, other.frame = self._library, self.path, frame
        other._begin(self)
        numbers = (ctypes.c_double * 4)(*frame.centre, frame.scale)
        self._library.runtime_place(other._field, self._field, numbers)
        return other

    def moving(self) -> "moving.MovingField":
        """Return a `MovingField` of this one, which must be an exact mesh.

        Raises
        ------
        ValueError
            The field is of another kind: it has no vertices that could move.
        """
        from pandis.runtime.field.moving import MovingField

        return MovingField(self)

    @property
    def kind(self) -> int:
        """NETWORK, GRID, SPLINE, MESH, SHAPE or COMPACT."""
        return self._library.pandis_field_kind(self._field)

    @property
    def bytes(self) -> int:
        """How many bytes its answers are made of.

        All that a program holds in memory but what says where to trust the field and where it is
        from.
        """
        return self._library.runtime_bytes(self._field)

    @property
    def has_distance(self) -> bool:
        """Whether it knows a distance outside: all do but grids of forces, which have no slope."""
        somewhere = self.frame.to_mesh([[0.31, -0.27, 0.19]])  # in the middle a slope may vanish
        return self.kind != GRID or bool(self.query_slopes(somewhere)[1][0] > 0)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The lowest and highest corner (3,) of the box in which the surface lies, mesh units."""
        low, high = np.empty(3), np.empty(3)
        self._library.pandis_bounds(self._field, low.ctypes.data, high.ctypes.data)
        return low, high

    @property
    def address(self) -> int:
        """Where the opened field lies, for other C code."""
        return ctypes.addressof(self._field)

    def query(self, points: ArrayLike) -> NativeAnswer:
        """Answer distances (n,), normals (n, 3) and flags (n,) at points (n, 3), mesh units."""
        return self._query(points)[0]

    def query_slopes(self, points: ArrayLike) -> tuple[NativeAnswer, Floats]:
        """Answer as `query`, and how long (n,) each normal was before it was made a unit vector."""
        return self._query(points, slopes=True)

    def clear(self, points: ArrayLike) -> Floats:
        """Return how far (n,) from points (n, 3) no surface is, mesh units.

        Where an answer is cut, that is proved; elsewhere it is the distance without its sign.
        """
        points = as_rows(points)
        clear = np.empty(len(points))
        self._library.runtime_clear(self._field, points.ctypes.data, len(points), clear.ctypes.data)
        return clear

    def faces(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the faces (n,) of ``mesh.zarr.zip`` on which the closest points to (n, 3) lie.

        Of an exact mesh, and of a compact one with ``export.original_faces``; -1 elsewhere, and
        where there is no answer.
        """
        points = as_rows(points)
        faces = np.empty(len(points), np.int32)
        self._library.runtime_faces(self._field, points.ctypes.data, len(points), faces.ctypes.data)
        return faces

    def regions(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the regions (n,) in which the closest points to (n, 3) lie; -1 where none is said.

        Of an exact and of a compact mesh whose source names materials.
        """
        points = as_rows(points)
        regions = np.empty(len(points), np.int32)
        self._library.runtime_regions(
            self._field, points.ctypes.data, len(points), regions.ctypes.data
        )
        return regions

    @property
    def region_names(self) -> tuple[str, ...]:
        """What the regions are called, in their order: the materials that the mesh's file names."""
        names = []
        while (name := self._library.pandis_region(self._field, len(names))) is not None:
            names.append(name.decode())
        return tuple(names)

    def query_within(self, points: ArrayLike, reach: Number) -> tuple[NativeAnswer, Floats]:
        """Answer points (n, 3) that are nearer to the surface than ``reach``, mesh units.

        Returns
        -------
        answer : NativeAnswer
            As of `query`; NaN, flagged 4, where no surface is within reach. A cut answer (flag
            `CUT`) stays: the surface may be nearer than it says.
        clear : ndarray, shape (n,)
            No surface is nearer than this.
        """
        if not reach >= 0:
            raise ValueError(f"a reach is a number from 0 on, not {reach}")
        answer, clear = self._answers(points, reach)
        beyond = (np.abs(answer.distance) > reach) & (answer.flag != CUT)
        answer.distance[beyond], answer.normal[beyond], answer.flag[beyond] = np.nan, np.nan, BEYOND
        return answer, clear

    def follow(self, points: ArrayLike) -> NativeAnswer:
        """Answer points (n, 3) of a path, each with what is known from the one before.

        Returns
        -------
        NativeAnswer
            That of `query`, to the last bit.
        """
        return self._answers(points, -1.0)[0]

    def _answers(self, points, reach):
        points = as_rows(points)
        count = len(points)
        answer = NativeAnswer(np.empty(count), np.empty((count, 3)), np.empty(count, np.uint8))
        clear = np.empty(count)
        columns = [column.ctypes.data for column in (*answer, clear)]
        self._library.runtime_answers(self._field, points.ctypes.data, count, reach, *columns)
        return answer, clear

    def _query(self, points, slopes=False):
        points = as_rows(points)
        count = len(points)
        answer = NativeAnswer(np.empty(count), np.empty((count, 3)), np.empty(count, np.uint8))
        lengths = np.empty(count) if slopes else None

        def part(low, high):
            columns = [points[low:], *(column[low:] for column in answer)]
            where = [column.ctypes.data for column in columns]
            where.append(lengths[low:].ctypes.data if slopes else None)
            self._library.runtime_query(self._field, where[0], high - low, *where[1:])

        # a network is slow enough that a second thread pays at once
        in_threads(part, count, small=_FEW if self.kind == NETWORK else SMALL)
        return answer, lengths

    def distance_and_normal(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Answer distances (n,) and unit normals (n, 3) at points (n, 3), all in mesh units."""
        return self.query(points)[:2]

    def gradient(self, points: ArrayLike) -> Floats:
        """Return the gradients (n, 3) of the distance at points (n, 3).

        Of meshes and closed forms it is the normal. Elsewhere it may be shorter or longer than 1,
        and of the paper's network it is not the direction that the network answers: it belongs to
        the distance. NaN where there is no answer, and of grids of forces, which have no distance.
        """
        return self._derivatives(points)[0]

    def hessian(self, points: ArrayLike) -> Floats:
        """Return the second derivatives (n, 3, 3) of the distance at points (n, 3), per mesh unit.

        They are analytic for meshes and closed forms (by what is nearest: 0 next to a face, round
        next to an edge or a corner), for splines and for grids of distances. Of networks, and where
        a point is flagged as a bound, they are differences over a few thousandths of the object or
        less. NaN where `gradient` is.
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
            Stiffness, force per mesh unit: a finite number from 0 on.

        Raises
        ------
        ValueError
            ``k`` is another number.
        """
        if not 0 <= k < np.inf:
            raise ValueError(f"k is a finite number from 0 on, not {k}")
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
        reach: Number | None = None,
        follow: bool = False,
    ) -> Floats:
        """Return the seconds (queries,) of single queries at points (n, 3) in turn.

        ``cold``: before each of them other work empties the caches. ``reach``: as `query_within`
        asks; ``follow``: as `follow` does.
        """
        points = as_rows(points)
        if not len(points) or queries < 1:
            raise ValueError("at least one point and one query are needed")
        taken, other = np.empty(queries), np.zeros(CACHES if cold else 0, np.uint8)
        how = -2.0 if follow else -1.0 if reach is None else reach
        self._library.runtime_time(
            self._field, points.ctypes.data, len(points), queries, how, taken.ctypes.data,
            other.ctypes.data, len(other),
        )  # fmt: skip
        return taken

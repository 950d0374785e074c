"""Several objects under one probe; only those that it may touch are queried."""

import ctypes
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.engine.compiler import load
from pandis.engine.layout import compare_layouts
from pandis.runtime.field import ArrayLike, Floats, NativeField, Number
from pandis.runtime.field.binding import library as runtime

_UPRIGHT = np.eye(3)


class Placed(NamedTuple):
    """A field and its pose in a scene.

    Attributes
    ----------
    field : pandis.runtime.field.NativeField
    rotation : ndarray, shape (3, 3)
        A mesh point p is at ``scale * rotation @ p + translation`` in the scene.
    translation : ndarray, shape (3,)
        Scene units.
    scale : float
        Scene lengths per mesh unit.
    stiffness : float
        Force per scene length.
    """

    field: NativeField
    rotation: ArrayLike
    translation: ArrayLike
    scale: float
    stiffness: float

    @classmethod
    def at(
        cls,
        field: NativeField,
        size: Number,
        stiffness: Number,
        *,
        position: ArrayLike = (0, 0, 0),
        rotation: ArrayLike = _UPRIGHT,
    ) -> "Placed":
        """Place a field: its box centred at ``position``, its longest side equal to ``size``."""
        scale = size * field.frame.scale / UNIT_SIDE
        centre = scale * np.asarray(rotation) @ np.array(field.frame.centre)
        return cls(field, rotation, np.array(position) - centre, scale, stiffness)


class Answers(NamedTuple):
    """Forces (n, 3), flags (n,), numbers of queried fields (n,), and seconds (n,) or None."""

    force: Floats
    flag: NDArray[np.uint8]
    queries: NDArray[np.int64]
    seconds: Floats | None


class _Object(ctypes.Structure):
    _fields_ = (
        ("field", ctypes.c_void_p),
        ("rotation", ctypes.c_double * 9),
        ("translation", ctypes.c_double * 3),
        ("scale", ctypes.c_double),
        ("stiffness", ctypes.c_double),
    )


class Pose(ctypes.Structure):
    """Pose and velocity of an object in a frame of a simulation: ``pandis_pose``."""

    _fields_ = (
        ("rotation", ctypes.c_double * 9),
        ("translation", ctypes.c_double * 3),
        ("velocity", ctypes.c_double * 3),
        ("spin", ctypes.c_double * 3),
    )


def _fill(place, placed):
    place.field = placed.field.address
    place.rotation[:] = np.ravel(placed.rotation).tolist()
    place.translation[:] = np.ravel(placed.translation).tolist()
    place.scale, place.stiffness = placed.scale, placed.stiffness


def placed_object(placed):
    """Return the C object of a `Placed`; the caller must keep the `Placed` alive with it."""
    entry = _Object()
    _fill(entry, placed)
    return entry


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("scene.c"))
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    compare_layouts(lib.scene_layout, {"pandis_object": _Object, "pandis_pose": Pose})
    for name in ("scene_bytes", "scene_room", "scene_poses_bytes", "scene_poses_room"):
        getattr(lib, name).restype = size
    lib.scene_room.argtypes = lib.scene_poses_room.argtypes = [size]
    lib.pandis_poses_open.argtypes = [pointer, pointer, size, pointer, size]
    lib.pandis_poses_give.argtypes = [pointer, pointer, size, ctypes.c_double]
    lib.pandis_poses_step.argtypes = [pointer, pointer, ctypes.c_double]
    lib.pandis_scene_open.argtypes = [pointer, pointer, size, pointer, size]
    lib.pandis_scene_moved.argtypes = [pointer, size]
    lib.scene_forces.argtypes = [pointer, pointer, size, *[pointer] * 4]
    lib.scene_ask_all.argtypes = [pointer, size, pointer, size, pointer]
    return lib


class NativeScene:
    """Objects under one probe, evaluated by ``pandis.h``.

    Parameters
    ----------
    objects : list of Placed

    Raises
    ------
    PandisError
        An object's pose is invalid: its matrix is not a rotation, or its scale is not positive.
    """

    def __init__(self, objects: Iterable[Placed]) -> None:
        self._library, self.objects = library(), list(objects)
        count = len(self.objects)
        self._placed = (_Object * max(count, 1))()
        for place, placed in zip(self._placed, self.objects, strict=False):
            _fill(place, placed)
        self._room = np.empty(max(self._library.scene_room(count), 1))
        self._scene = ctypes.create_string_buffer(self._library.scene_bytes())
        self._check(
            self._library.pandis_scene_open(
                self._scene, self._placed, count, self._room.ctypes.data, len(self._room)
            )
        )

    def _check(self, error):
        if error:
            raise PandisError(runtime().pandis_error_text(error).decode())

    def move(self, index: int, placed: Placed) -> None:
        """Change an object's pose, its field, or both.

        Raises
        ------
        PandisError
            The pose is invalid; the object is left out until a valid one is set.
        """
        index = range(len(self.objects))[index]
        self.objects[index] = placed
        _fill(self._placed[index], placed)
        self._check(self._library.pandis_scene_moved(self._scene, index))

    @property
    def address(self) -> int:
        """Address of the C scene, for other C code."""
        return ctypes.addressof(self._scene)

    @property
    def placed_address(self) -> int:
        """Address of the C objects, for other C code, which may move them (`Poses`)."""
        return ctypes.addressof(self._placed)

    def lies(self, index: int) -> tuple[Floats, Floats]:
        """Return an object's current rotation (3, 3) and translation (3,)."""
        place = self._placed[range(len(self.objects))[index]]
        return np.array(place.rotation).reshape(3, 3), np.array(place.translation)

    def answer(self, points: ArrayLike, timed: bool = False) -> Answers:
        """Return `Answers` along a path (n, 3), scene units, querying only the fields needed."""
        points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        count = len(points)
        force, flag = np.empty((count, 3)), np.empty(count, np.uint8)
        queries, seconds = np.empty(count, np.int64), np.empty(count) if timed else None
        self._library.scene_forces(
            self._scene, points.ctypes.data, count, force.ctypes.data, flag.ctypes.data,
            queries.ctypes.data, seconds.ctypes.data if timed else None,
        )  # fmt: skip
        return Answers(force, flag, queries, seconds)

    def ask_all(self, points: ArrayLike) -> Floats:
        """Return the forces (n, 3) at points (n, 3), querying every object at every point."""
        points = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        force = np.empty_like(points)
        self._library.scene_ask_all(
            self._placed, len(self.objects), points.ctypes.data, len(points), force.ctypes.data
        )
        return force

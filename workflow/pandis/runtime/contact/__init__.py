"""Contacts of ``pandis.h``: a proxy that never passes through a wall."""

import ctypes
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pandis.base.errors import PandisError
from pandis.engine.compiler import load
from pandis.engine.layout import compare_layouts
from pandis.runtime.contact.surfaces import Material, Texture, as_array
from pandis.runtime.field import ArrayLike, Floats, NativeField, Number
from pandis.runtime.field.binding import library as runtime
from pandis.runtime.scene import NativeScene, Placed, placed_object

#: One material for a surface, or one for each of its regions.
Materials = Material | Sequence[Material] | None
#: Bits of `Touches.state`, as in ``pandis.h``.
TOUCHING, STICKING, BEHIND, WAITING = 1, 2, 4, 8


class Options(ctypes.Structure):
    """Options of a contact: ``pandis_contact_options``.

    Attributes
    ----------
    radius : float
        Radius of the probe, scene lengths.
    slide : float
        Largest excess of the proxy's speed over the probe's, scene lengths per second.
    budget : int
        Number of queries after which a step ends.
    """

    _fields_ = (
        ("radius", ctypes.c_double),
        ("slide", ctypes.c_double),
        ("budget", ctypes.c_int32),
        ("materials", ctypes.c_void_p),
        ("material_count", ctypes.c_size_t),
        ("texture", ctypes.c_void_p),
        ("regions", ctypes.c_void_p),
    )

    def feel(self, materials, regions, texture):
        """Set the materials (the caller keeps the array alive), source of regions, and texture."""
        self.materials, self.material_count = ctypes.addressof(materials), len(materials)
        self.texture = None if texture is None else ctypes.addressof(texture)
        self.regions = None if regions is None else regions.address


class Touches(NamedTuple):
    """Results of contact steps, one row each, in the scene's units and coordinates.

    Attributes
    ----------
    force, proxy, normal : ndarray, shape (n, 3)
        The normal is that of the surface against which the proxy is pressed, or 0.
    depth, slip : ndarray, shape (n,)
        Distance from proxy to probe along the normal, and distance that the proxy slid.
    state, flag, planes, queries, face, region : ndarray, shape (n,)
        As in ``pandis_touch``.
    seconds : ndarray, shape (n,), or None
    """

    force: Floats
    proxy: Floats
    normal: Floats
    depth: Floats
    slip: Floats
    state: NDArray[np.int32]
    flag: NDArray[np.int32]
    planes: NDArray[np.int32]
    queries: NDArray[np.int32]
    face: NDArray[np.int32]
    region: NDArray[np.int32]
    seconds: Floats | None

    @classmethod
    def empty(cls, count: int, timed: bool) -> "Touches":
        """Return uninitialised rows for ``count`` steps."""
        vectors = [np.empty((count, 3)) for _ in range(3)]
        numbers = [np.empty(count) for _ in range(2)]
        whole = [np.empty(count, np.int32) for _ in range(6)]
        return cls(*vectors, *numbers, *whole, np.empty(count) if timed else None)


class _Rows(ctypes.Structure):
    _order = (
        *("force", "proxy", "normal", "depth", "slip", "seconds"),
        *("state", "flag", "planes", "queries", "face", "region"),
    )
    _fields_ = tuple((name, ctypes.c_void_p) for name in _order)

    @classmethod
    def of(cls, touches):
        columns = touches._asdict()
        return cls(*(None if columns[name] is None else columns[name].ctypes.data
                     for name in cls._order))  # fmt: skip


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("contact.c"))
    pointer, f64 = ctypes.c_void_p, ctypes.c_double
    size = ctypes.c_size_t
    lib.contact_bytes.restype = lib.contact_touch_bytes.restype = size
    mirrors = {"pandis_contact_options": Options, "pandis_material": Material}
    compare_layouts(lib.contact_layout, mirrors | {"pandis_texture": Texture})
    lib.pandis_contact_open.argtypes = [pointer] * 3
    lib.pandis_contact_defaults.restype = lib.pandis_contact_get.restype = Options
    lib.pandis_contact_defaults.argtypes = lib.pandis_contact_get.argtypes = [pointer]
    lib.pandis_contact_set.argtypes = [pointer, pointer]
    lib.pandis_contact_reshaped.argtypes = [pointer]
    lib.contact_follow.argtypes = [pointer, pointer, pointer, size, f64, pointer]
    lib.pandis_scene_touch_open.argtypes = [pointer, pointer, pointer, size]
    lib.contact_scene_follow.argtypes = [pointer, pointer, size, f64, *[pointer] * 5]
    lib.contact_scene_touches.restype = size
    lib.contact_scene_touches.argtypes = [pointer, pointer, f64, *[pointer] * 3, size]
    lib.contact_step_all.argtypes = [pointer, pointer, size, pointer, size, f64, pointer]
    return lib


def _check(error):
    if error:
        raise PandisError(runtime().pandis_error_text(error).decode())


class Feel(NamedTuple):
    """A probe with a proxy, and the properties of the surface that it touches.

    Attributes
    ----------
    radius : float
        Radius of the probe, scene lengths.
    materials : sequence of Material
        Materials of the surface, or of each of its regions.
    regions : pandis.runtime.field.NativeField, optional
        Source of regions if the object's field has none: a mesh of the same object.
    queries : int
        Number of queries after which a step ends.
    texture : pandis.runtime.contact.surfaces.Texture, optional
        Texture of the surface.
    """

    radius: float = 0.0
    materials: Sequence[Material] = (Material(),)
    regions: NativeField | None = None
    queries: int = 24
    texture: Texture | None = None

    def scene(self, placed: Placed) -> "TouchedScene":
        """Return a `TouchedScene` of this object alone."""
        return TouchedScene(
            [placed],
            self.radius,
            [self.materials],
            regions=[self.regions],
            budget=self.queries,
            textures=[self.texture],
        )


class NativeContact:
    """A probe that is kept out of an object.

    Parameters
    ----------
    placed : pandis.runtime.scene.Placed
    radius : float
        Radius of the probe, scene lengths.
    material : Material, or sequence of Material, optional
        Material of the surface, or of each of its regions; smooth and undamped by default.
    regions : pandis.runtime.field.NativeField, optional
        Source of regions if the object's field has none: a mesh of the same object.
    texture : pandis.runtime.contact.surfaces.Texture, optional
        Texture of the surface.

    Raises
    ------
    PandisError
        The object's pose is invalid, or its field is a grid of forces, which has no distances
        outside.
    """

    def __init__(
        self,
        placed: Placed,
        radius: Number = 0.0,
        material: Materials = None,
        *,
        regions: NativeField | None = None,
        texture: Texture | None = None,
    ) -> None:
        self._library, self.placed, self._regions = library(), placed, regions
        self.texture = texture
        self.materials = as_array(material)
        self._object = placed_object(placed)
        self._state = ctypes.create_string_buffer(self._library.contact_bytes())
        options = self._library.pandis_contact_defaults(ctypes.byref(self._object))
        options.radius = radius
        options.feel(self.materials, regions, texture)
        _check(
            self._library.pandis_contact_open(
                self._state, ctypes.byref(self._object), ctypes.byref(options)
            )
        )

    @property
    def options(self) -> Options:
        """A copy of the contact's `Options`; use `set` to change them."""
        return self._library.pandis_contact_get(self._state)

    def set(self, **changes: Number) -> None:
        """Change ``radius``, ``slide`` or ``budget``, from the next step on.

        Raises
        ------
        PandisError
            A value is out of range; in this case no option is changed.
        """
        options = self.options
        for name, value in changes.items():
            setattr(options, name, value)
        _check(self._library.pandis_contact_set(self._state, ctypes.byref(options)))

    def move(self, placed: Placed) -> None:
        """Move the object; the proxy moves with it."""
        self.placed, self._object = placed, placed_object(placed)

    def reshaped(self) -> None:
        """Report that the shape of the object's field has changed (`MovingField.refit`)."""
        self._library.pandis_contact_reshaped(self._state)

    def follow(self, path: ArrayLike, dt: Number = 1e-3, timed: bool = False) -> Touches:
        """Step along a path.

        Parameters
        ----------
        path : ndarray, shape (n, 3)
            Positions of the probe, scene units.
        dt : float
            Seconds between positions.
        timed : bool
            Whether to time each step.

        Returns
        -------
        Touches
        """
        path = np.ascontiguousarray(path, np.float64).reshape(-1, 3)
        touches = Touches.empty(len(path), timed)
        self._library.contact_follow(
            self._state, ctypes.byref(self._object), path.ctypes.data, len(path), dt,
            ctypes.byref(_Rows.of(touches)),
        )  # fmt: skip
        return touches


class SceneForces(NamedTuple):
    """Per step: force (n, 3), flag, numbers of queries and of touched objects, and seconds (n,)."""

    force: Floats
    flag: NDArray[np.uint8]
    queries: NDArray[np.int64]
    touched: NDArray[np.int64]
    seconds: Floats | None


class TouchedScene(NativeScene):
    """Objects under one probe, which is kept out of all of them.

    Parameters
    ----------
    objects : list of pandis.runtime.scene.Placed
    radius : float
        Radius of the probe, scene lengths.
    materials : list of (Material, sequence of Material, or None), optional
        For each object, the material of its surface or of each of its regions.
    regions : list of (pandis.runtime.field.NativeField or None), optional
        For each object, a mesh that supplies regions if the object's field has none.
    budget : int, optional
        Number of queries after which a contact's step ends; 24 by default.
    textures : list of (pandis.runtime.contact.surfaces.Texture or None), optional
        For each object, the texture of its surface.

    Raises
    ------
    PandisError
        An object's pose is invalid, or its field is a grid of forces.
    """

    def __init__(
        self,
        objects: Iterable[Placed],
        radius: Number = 0.0,
        materials: Iterable[Materials] | None = None,
        *,
        regions: Iterable[NativeField | None] | None = None,
        budget: int | None = None,
        textures: Iterable[Texture | None] | None = None,
    ) -> None:
        super().__init__(objects)
        self._touching = library()
        count = len(self.objects)
        self.materials = [as_array(m) for m in materials or [None] * count]
        self._regions, self._budget = list(regions or [None] * count), budget
        self._textures = list(textures or [None] * count)
        self._contacts = ctypes.create_string_buffer(max(count, 1) * self._touching.contact_bytes())
        self.radius = radius
        self.restart()

    def restart(self) -> None:
        """Restart all contacts. The next position must be outside all objects."""
        self._check(self._open(self._contacts))

    def _open(self, contacts):
        count, defaults = len(self.objects), self._touching.pandis_contact_defaults
        options = (Options * max(count, 1))()
        feels = zip(self.materials, self._regions, self._textures, strict=True)
        for i, feel in enumerate(feels):
            options[i] = defaults(ctypes.byref(self._placed[i]))
            options[i].radius = self.radius
            options[i].feel(*feel)
            if self._budget is not None:
                options[i].budget = self._budget
        return self._touching.pandis_scene_touch_open(self._scene, contacts, options, count)

    def follow(self, path: ArrayLike, dt: Number = 1e-3, timed: bool = False) -> SceneForces:
        """Step along a path (n, 3), scene units, with ``dt`` seconds between positions."""
        path = np.ascontiguousarray(path, np.float64).reshape(-1, 3)
        count = len(path)
        force, flag = np.empty((count, 3)), np.empty(count, np.uint8)
        queries, touched = np.empty(count, np.int64), np.empty(count, np.int64)
        seconds = np.empty(count) if timed else None
        self._touching.contact_scene_follow(
            self._scene, path.ctypes.data, count, dt, force.ctypes.data, flag.ctypes.data,
            queries.ctypes.data, touched.ctypes.data, seconds.ctypes.data if timed else None,
        )  # fmt: skip
        return SceneForces(force, flag, queries, touched, seconds)

    def touches(self, position: ArrayLike, dt: Number = 1e-3) -> tuple[NDArray[np.int32], Touches]:
        """Make one step; return the indices (n,) of touched objects, and their `Touches`."""
        most = len(self.objects)
        position = np.ascontiguousarray(position, np.float64)
        rows, objects = Touches.empty(most, False), np.empty(most, np.int32)
        room = ctypes.create_string_buffer(max(most, 1) * self._touching.contact_touch_bytes())
        count = self._touching.contact_scene_touches(
            self._scene, position.ctypes.data, dt, ctypes.byref(_Rows.of(rows)),
            objects.ctypes.data, room, most,
        )  # fmt: skip
        return objects[:count], Touches(*(None if c is None else c[:count] for c in rows))

    def step_all(self, path: ArrayLike, dt: Number = 1e-3) -> Floats:
        """Return the forces (n, 3) along a path, stepping every object's contact at every step.

        This uses separate contacts, which begin at the start of the path. Afterwards the scene's
        own contacts are restarted.
        """
        path = np.ascontiguousarray(path, np.float64).reshape(-1, 3)
        others = ctypes.create_string_buffer(len(self._contacts))
        self._check(self._open(others))
        force = np.empty_like(path)
        self._touching.contact_step_all(
            self._placed,
            others,
            len(self.objects),
            path.ctypes.data,
            len(path),
            dt,
            force.ctypes.data,
        )
        self.restart()
        return force

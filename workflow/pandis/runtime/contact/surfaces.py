"""Surface properties that a proxy feels: friction and damping by region, and textures."""

import ctypes
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pandis.engine.compiler import load
from pandis.runtime.field import ArrayLike, Number

SOURCE = Path(__file__).with_name("contact.c")
#: Function that returns a texture's height and gradient at a point (3,) in a region.
Height = Callable[[NDArray[np.float64], int], tuple[float, ArrayLike]]
#: Name used for a surface with a single material.
WHOLE = "the surface"
#: The texture kind that stands for no texture.
SMOOTH = "smooth"


class Material(ctypes.Structure):
    """Properties of a surface, apart from stiffness, which is a property of the object.

    Attributes
    ----------
    sticking, sliding : float
        Coefficients of static and sliding friction: tangential force per normal force.
    damping : float
        Force per speed of the probe along the normal; it never pulls towards the surface.
    drag : float
        Force per speed of the proxy along the surface.
    """

    _fields_ = tuple((name, ctypes.c_double) for name in ("sticking", "sliding", "damping", "drag"))


def materials_for(contact, names):
    """Return the properties of an object's materials, in the order of its regions.

    Parameters
    ----------
    contact : pandis.pipeline.run.ask.contacts.SurfaceOptions
    names : sequence of str or None
        Names of the regions; if there are none, the whole surface has one material.

    Returns
    -------
    dict of str to dict
        For each name, the fields of a `Material`.
    """
    surfaces = {name: contact.materials.get(name, contact) for name in names or ()}
    return {
        name: {
            "sticking": surface.sticking,
            "sliding": surface.sticking if surface.sliding is None else surface.sliding,
            "damping": surface.damping,
            "drag": surface.drag,
        }
        for name, surface in (surfaces or {WHOLE: contact}).items()
    }


def textures_for(contact, names):
    """Return the textures of an object's materials, in the order of its regions.

    Parameters
    ----------
    contact : pandis.pipeline.run.ask.contacts.SurfaceOptions
    names : sequence of str or None
        Names of the regions.

    Returns
    -------
    dict of str to (pandis.pipeline.run.ask.contacts.TextureOptions or None)
        Empty if no material has a texture.
    """
    textures = {
        name: contact.materials.get(name, contact).texture or contact.texture
        for name in names or (WHOLE,)
    }
    rough = {
        name: texture and (None if texture.kind == SMOOTH else texture)
        for name, texture in textures.items()
    }
    return rough if any(rough.values()) else {}


def unknown_materials(contact, names):
    """Return the configured materials that no face of an object has, sorted.

    Parameters
    ----------
    contact : pandis.pipeline.run.ask.contacts.SurfaceOptions
    names : sequence of str or None
        Names of the regions.
    """
    return sorted(set(contact.materials) - set(names or ()))


def texture_for(textures, scale):
    """Return the combined texture of an object, or None if it has none.

    Parameters
    ----------
    textures : dict of str to (pandis.pipeline.run.ask.contacts.TextureOptions or None)
        From `textures_for`.
    scale : float
        Metres per unit of the object's mesh.
    """
    parts = [options and _texture(options, scale) for options in textures.values()]
    return parts[0] if len(parts) == 1 else Texture.by_region(parts) if parts else None


def _texture(options, scale):
    height, length = options.height / scale, options.length / scale
    if options.kind == "noise":
        return Texture.noise(height, length)
    return Texture.waves(height, length, options.direction)


def as_array(material):
    """Convert one material, several, or None (a smooth surface) to a C array."""
    several = [material] if material is None or isinstance(material, Material) else material
    return (Material * len(several))(*(Material() if m is None else m for m in several))


#: Type of a texture's height function in C.
HEIGHT = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_void_p, ctypes.POINTER(ctypes.c_double * 3), ctypes.c_int,
    ctypes.POINTER(ctypes.c_double * 3),
)  # fmt: skip


class _Patches(ctypes.Structure):
    _fields_ = (("textures", ctypes.c_void_p), ("count", ctypes.c_int32))


class Texture(ctypes.Structure):
    """A height map over a surface, felt through a proxy; mesh units.

    Attributes
    ----------
    most, steepest : float
        Largest height, and largest magnitude of its gradient.
    numbers : tuple of float
        For waves and bumps: height and length; for waves also the direction.
    parts : list of Texture
        For `by_region`: the textures of the regions.
    """

    _fields_ = (
        ("height", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
        ("most", ctypes.c_double),
        ("steepest", ctypes.c_double),
    )

    @classmethod
    def _of(cls, name, most, steepest, *numbers):
        data = (ctypes.c_double * len(numbers))(*numbers)
        function = ctypes.cast(getattr(load(SOURCE), name), ctypes.c_void_p)
        texture = cls(function, ctypes.addressof(data), most, steepest)
        texture._memory, texture.numbers = data, numbers
        return texture

    @classmethod
    def waves(cls, height: Number, length: Number, direction: ArrayLike) -> "Texture":
        """Return waves of a given height and wavelength that vary along a direction (3,)."""
        x, y, z = np.asarray(direction, float) / np.linalg.norm(direction)
        return cls._of("pandis_waves", height, np.pi * height / length, height, length, x, y, z)

    @classmethod
    def noise(cls, height: Number, length: Number) -> "Texture":
        """Return pseudorandom bumps of a given height, one per cube of side ``length``."""
        return cls._of("pandis_noise", height, 3.25 * height / length, height, length)

    @classmethod
    def by_region(cls, textures: Iterable["Texture | None"]) -> "Texture":
        """Combine the textures of a surface's regions into one; None stands for a smooth region."""
        parts = [cls() if each is None else each for each in textures]
        table = (cls * len(parts))(*parts)
        patches = _Patches(ctypes.addressof(table), len(parts))
        height = ctypes.cast(load(SOURCE).pandis_by_region, ctypes.c_void_p)
        most, steepest = (max(getattr(each, k) for each in parts) for k in ("most", "steepest"))
        texture = cls(height, ctypes.addressof(patches), most, steepest)
        texture._memory, texture.parts = (table, patches), parts
        return texture

    @classmethod
    def of(cls, function: Height, most: Number, steepest: Number) -> "Texture":
        """Return a texture from a function that returns height and gradient: see `Height`."""

        def height(_, point, region, gradient):
            raised, slope = function(np.array(point.contents), region)
            gradient.contents[:] = slope
            return raised

        texture = cls(None, None, most, steepest)
        texture._memory = HEIGHT(height)
        texture.height = ctypes.cast(texture._memory, ctypes.c_void_p)
        return texture

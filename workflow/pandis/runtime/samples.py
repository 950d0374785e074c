"""Closed forms as fields: something to try a program on, without a mesh and without a run."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.runtime.field import SHAPE, SHAPES, NativeField, Number
from pandis.runtime.field.files import pack

#: Default sizes by shape (docs/format.md), mesh units.
SIZES = {"sphere": (1.0,), "torus": (1.0, 0.4), "box": (1.0, 0.7, 0.5), "capsule": (0.4, 0.6)}


def sample(shape: str, *sizes: Number) -> NativeField:
    """Return the field of a closed form.

    Parameters
    ----------
    shape : {"sphere", "torus", "box", "capsule"}
        Around the origin, torus and capsule along z.
    sizes : float, optional
        In units of your own: the radius; ring and tube; half the sides; radius and half the axis.

    Raises
    ------
    PandisError
        There is no such shape, or it has other sizes.
    """
    return NativeField(sample_bytes(shape, *sizes))


def sample_bytes(shape: str, *sizes: Number) -> bytes:
    """Return what the ``.pandis`` file of a closed form holds; parameters as of `sample`."""
    if shape not in SIZES:
        raise PandisError(f"{shape}: there is no such shape; there are {', '.join(SIZES)}")
    numbers = tuple(float(size) for size in sizes or SIZES[shape])
    count = len(SIZES[shape])
    if len(numbers) != count or not all(np.isfinite(size) and size > 0 for size in numbers):
        raise PandisError(f"{shape}: it has {count} sizes, each above zero, not {numbers}")
    half = _half(shape, numbers)
    frame = Frame.of_bounds(-half, half)
    corners = frame.to_unit(np.stack([-half, half]))
    safe = np.concatenate([corners.ravel(), [0.0, 0.0]])  # its answers are exact everywhere
    wholes, provenance = [SHAPES.index(shape)], {"options": {"field": "exact"}}
    return pack(SHAPE, frame, wholes, numbers, {"SAFE": safe}, provenance)


def _half(shape, sizes):
    """Return half the sides of a shape's box."""
    if shape == "torus":
        ring, tube = sizes
        return np.array([ring + tube, ring + tube, tube])
    if shape == "capsule":
        radius, axis = sizes
        return np.array([radius, radius, axis + radius])
    return np.array(sizes if shape == "box" else 3 * sizes)

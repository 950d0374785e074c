"""Closed-form shapes as fields, to try out a program without a mesh or a workflow run."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.frame import Frame
from pandis.runtime.field import NativeField, Number
from pandis.runtime.field.constants import SHAPE, SHAPES
from pandis.runtime.field.files import Parts, pack

#: Default sizes by shape (docs/format.md), mesh units.
SIZES = {"sphere": (1.0,), "torus": (1.0, 0.4), "box": (1.0, 0.7, 0.5), "capsule": (0.4, 0.6)}


def sample(shape: str, *sizes: Number) -> NativeField:
    """Return the field of a closed form.

    Parameters
    ----------
    shape : {"sphere", "torus", "box", "capsule"}
        Centred at the origin; the axis of torus and capsule is z.
    sizes : float, optional
        In any unit. Sphere: radius; torus: radii of ring and tube; box: half the length of each
        side; capsule: radius and half the length of the axis.

    Raises
    ------
    PandisError
        There is no such shape, or the sizes are invalid.
    """
    return NativeField(sample_bytes(shape, *sizes))


def sample_bytes(shape: str, *sizes: Number) -> bytes:
    """Return the content of a closed form's ``.pandis`` file; parameters as for `sample`."""
    if shape not in SIZES:
        raise PandisError(f"{shape}: no such shape; choose one of {', '.join(SIZES)}")
    numbers = tuple(float(size) for size in sizes or SIZES[shape])
    count = len(SIZES[shape])
    if len(numbers) != count or not all(np.isfinite(size) and size > 0 for size in numbers):
        sizes = "a finite size" if count == 1 else f"{count} finite sizes"
        raise PandisError(f"{shape}: give {sizes} above zero, not {numbers}")
    if shape == "torus" and numbers[1] >= numbers[0]:
        raise PandisError(f"torus: the tube's radius {numbers[1]:g} must be below the ring's")
    half = _half(shape, numbers)
    frame = Frame.of_bounds(-half, half)
    corners = frame.to_unit(np.stack([-half, half]))
    # margins and height are 0, because a closed form's answers are exact everywhere
    safe = np.concatenate([corners.ravel(), [0.0, 0.0, 0.0]])
    wholes, provenance = [SHAPES.index(shape)], {"options": {"field": "exact"}}
    return pack(frame, Parts(SHAPE, wholes, numbers, {"SAFE": safe}), provenance)


def _half(shape, sizes):
    """Return half the side lengths (3,) of a shape's bounding box."""
    if shape == "torus":
        ring, tube = sizes
        return np.array([ring + tube, ring + tube, tube])
    if shape == "capsule":
        radius, axis = sizes
        return np.array([radius, radius, axis + radius])
    return np.array(sizes if shape == "box" else 3 * sizes)

"""Splines and networks as differentiable functions for PyTorch and JAX.

PyTorch and JAX share one implementation. In it, `xp` is either ``torch`` or ``jax.numpy``, and only
functions that have the same name in both are called. Neither is imported before it is needed.
"""

from os import PathLike
from typing import Any

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.arrays.networks import network
from pandis.bridges.arrays.splines import spline
from pandis.runtime.field.constants import NETWORK, SPLINE
from pandis.runtime.field.files import read_contents

_KINDS = {SPLINE: spline, NETWORK: network}


class ArrayField:
    """A field as a function of arrays; created by `torch_field` or `jax_field`.

    Points (n, 3) are in mesh units. Answers have the floating-point type of the points. Splines are
    evaluated in that type, networks in single precision, as in training.
    """

    def __init__(self, path: str | PathLike[str], xp: Any, put: Any) -> None:
        contents = read_contents(path)
        self.path, self.frame = contents.field.path, contents.field.frame
        if contents.field.kind not in _KINDS:
            raise PandisError(f"{self.path}: only splines and networks can be evaluated on arrays")
        self._xp, self._put = xp, put
        self._answer, self._data = _KINDS[contents.field.kind](contents)
        self._placed: dict = {}

    def distance(self, points: Any) -> Any:
        """Return twice-differentiable distances (n,) at points (n, 3), in mesh units."""
        return self.answer(points)[0]

    def answer(self, points: Any) -> tuple[Any, Any]:
        """Return distances (n,) and normals (n, 3) at points (n, 3), as the C library does.

        No flags are returned, although distances outside the box or a spline's band are estimates.
        The normal of a network with one output is its gradient, which needs a second pass.
        """
        xp = self._xp
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points must be an array of shape (n, 3), not {tuple(points.shape)}")
        data, like = self._for(points), self._put(np.array(self.frame.centre), points)
        unit = (points - like) * self.frame.scale
        box = xp.clip(unit, -1, 1)
        way = unit - box
        beyond = (way * way).sum(-1)
        # avoid the square root of zero, which has no derivative
        away = xp.where(beyond > 0, xp.sqrt(xp.where(beyond > 0, beyond, 1.0)), 0.0)
        distance, direction = self._answer(xp, data, box, away=away, grad=_grad(xp))
        length = xp.sqrt((direction * direction).sum(-1, keepdims=True))
        up = self._put(np.array([0.0, 0.0, 1.0]), points)  # as in pandis.h, if no normal is defined
        normal = xp.where(length > 0, direction / xp.where(length > 0, length, 1.0), up)
        return distance / self.frame.scale, normal

    def _for(self, points):
        """Return the field's data on the device of the points."""
        if self._xp.__name__ != "torch":  # JAX traces functions, so arrays must not be cached
            return self._put_all(points)
        key = points.device, points.dtype
        if key not in self._placed:
            self._placed[key] = self._put_all(points)
        return self._placed[key]

    def _put_all(self, points):
        return {
            name: value if np.isscalar(value) else self._put(value, points)
            for name, value in self._data.items()
        }


def torch_field(path: str | PathLike[str]) -> ArrayField:
    """Return a spline or a network as a function of tensors, on the device of the points.

    Raises
    ------
    PandisError
        The field is of another kind.
    ArtifactError
        The file cannot be read, or is damaged.

    Examples
    --------
    >>> bunny = torch_field("results/bunny/export/spline-auto.pandis")
    >>> points = torch.zeros(5, 3, dtype=torch.float64, requires_grad=True)
    >>> bunny.distance(points).sum().backward()  # points.grad is the gradient
    """
    import torch

    def put(value, like):
        kind = like.dtype if value.dtype == np.float64 else None
        return torch.as_tensor(value, dtype=kind, device=like.device)

    return ArrayField(path, torch, put)


def jax_field(path: str | PathLike[str]) -> ArrayField:
    """Return a spline or a network as a JAX function that can be compiled and vectorised.

    Raises
    ------
    PandisError
        The field is of another kind.
    ArtifactError
        The file cannot be read, or is damaged.

    Examples
    --------
    >>> bunny = jax_field("results/bunny/export/spline-auto.pandis")
    >>> gradient = jax.grad(lambda points: bunny.distance(points).sum())
    """
    try:
        import jax.numpy
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"jax_field needs the package {error.name}: pip install 'pandis-fields[jax]'",
            name=error.name,
        ) from None

    def put(value, like):
        kind = like.dtype if value.dtype == np.float64 else value.dtype
        return jax.numpy.asarray(value, dtype=kind)

    return ArrayField(path, jax.numpy, put)


def _grad(xp):
    """Return a function that computes values (n,) and gradients of a map from points (n, 3)."""
    if xp.__name__ == "torch":

        def by_torch(function, points):
            leaf = points if points.requires_grad else points.detach().requires_grad_()
            with xp.enable_grad():
                value = function(leaf)
                (slope,) = xp.autograd.grad(value.sum(), leaf, create_graph=points.requires_grad)
            return (value, slope) if points.requires_grad else (value.detach(), slope)

        return by_torch
    import jax

    def by_jax(function, points):
        value, pull = jax.vjp(function, points)
        return value, pull(xp.ones_like(value))[0]

    return by_jax

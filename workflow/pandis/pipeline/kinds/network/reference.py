"""The sine network as a field, in NumPy: Sitzmann et al. 2020; paper, Fig. 1.

Training uses torch (`pandis.pipeline.kinds.network.training`). A query needs only products and
sines, so neither evaluation nor a user's program has to load torch.
"""

import copy

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.kinds.field import Field, clamp_to_box, normalise
from pandis.pipeline.kinds.network.base import BaseSpline
from pandis.pipeline.kinds.network.record import Architecture


def load_layers(artifact):
    """Return the layers of a model artifact with ω0 folded in.

    Returns
    -------
    list of (weight, bias)
        float32; weight (out, in). All but the last are followed by a sine.
    """
    shape = Architecture.of(artifact)
    count = shape.depth + 1
    layers = []
    for index in range(count):
        factor = np.float32(shape.omega if index < count - 1 else 1.0)
        weight, bias = (artifact.arrays[f"{kind}_{index}"] for kind in ("weight", "bias"))
        layers.append((weight * factor, bias * factor))
    return layers


def load_base(artifact):
    """Return the `BaseSpline` that the network of a model artifact corrects, or None."""
    coefficients = artifact.arrays.get("base")
    return None if coefficients is None else BaseSpline(coefficients)


class SirenField(Field):
    """A trained sine network: it gives (Φ, Ψ) at a point in one pass, or Φ and its gradient.

    If it has a base, a coarse spline of the distance, the spline's value is added to Φ, and its
    gradient to the direction.
    """

    kind = "network"
    keeps_length = True

    def __init__(self, name, artifact):
        self.layers = load_layers(artifact)
        self.base = load_base(artifact)
        size = sum(weight.nbytes + bias.nbytes for weight, bias in self.layers)
        if self.base is not None:
            size += self.base.coefficients.nbytes
        super().__init__(name, Frame.of(artifact), size)

    def in_double(self):
        """Return the same network in double precision, to measure the effect of rounding."""
        other = copy.copy(self)
        other.layers = [(w.astype(np.float64), b.astype(np.float64)) for w, b in self.layers]
        return other

    def direction(self, points):
        """Return Φ (n,) and the direction (n, 3), of any length, at points in the box.

        The direction is Ψ, or ∇Φ where Φ is the only output.
        """
        phi, direction = self._network(points)
        if self.base is None:
            return phi, direction
        value, gradient = self.base.evaluate(points)
        return phi + value, direction + gradient

    def _network(self, points):
        """Return Φ and the direction without the base, in the precision of the weights."""
        h, slopes = np.asarray(points, self.layers[0][0].dtype), []
        last, bias = self.layers[-1]
        own_gradient = len(last) == 1
        for weight, shift in self.layers[:-1]:
            z = h @ weight.T + shift
            h = np.sin(z)
            if own_gradient:
                slopes.append(np.cos(z))
        output = h @ last.T + bias
        if not own_gradient:
            return output[:, 0], output[:, 1:]
        chain = last
        for (weight, _), slope in zip(reversed(self.layers[:-1]), reversed(slopes), strict=True):
            chain = (chain * slope) @ weight
        return output[:, 0], chain

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        clamped, outside = clamp_to_box(points)
        phi, direction = self.direction(clamped)
        return phi.astype(np.float64) + outside, normalise(direction.astype(np.float64))


def open_field(spec, artifact):
    """Return the field of a `FieldSpec` from its artifact."""
    return SirenField(spec.name, artifact)

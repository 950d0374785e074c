"""The sine network in torch: Sitzmann et al. 2020, with the paper's four outputs or with one.

Forward and backward passes are written out, even those through the gradient with respect
to position: autograd would store and copy more, and would need a double backward pass.
"""

import itertools
import math

import torch

from pandis.pipeline.kinds.network.training.elements import (
    Aside,
    sines,
    slopes_back,
    slopes_forward,
)
from pandis.pipeline.kinds.network.training.products import product


def usual_omega(width):
    """Return the default ω0 for exact supervision; it is lower for narrower networks."""
    return 80.0 * (width / 256) ** 0.5


def named_arrays(parameters):
    """Return parameters (all weights, then all biases) as the arrays of a model artifact."""
    values = [p.detach().cpu().numpy() for p in parameters]
    count = len(values) // 2
    weights = {f"weight_{k}": value for k, value in enumerate(values[:count])}
    return weights | {f"bias_{k}": value for k, value in enumerate(values[count:])}


class Siren(torch.nn.Module):
    """x → sin(ω0·(W x + b)) … → (Φ, Ψ), or Φ alone.

    Parameters
    ----------
    width : int
        Units per sine layer.
    depth : int
        Number of sine layers (SIREN's ``num_hidden_layers`` plus one).
    omega : float
        ω0.
    outputs : int
        4 (Φ and Ψ), or 1 (Φ, whose gradient is then the direction).
    generator : torch.Generator
        Source of the initial weights.

    Notes
    -----
    Weights are initialised as in SIREN's code: U(±1/3) in the first layer and
    U(±sqrt(6 / width) / ω0) in the others, even in the last, which is not
    multiplied by ω0. Biases are U(±1 / sqrt(fan-in)).
    """

    def __init__(self, width, depth, omega, *, outputs, generator):
        super().__init__()
        self.omega = omega
        sizes = [3, *[width] * depth, outputs]
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        for index, (fan_in, fan_out) in enumerate(itertools.pairwise(sizes)):
            bound = 1 / fan_in if index == 0 else math.sqrt(6 / fan_in) / omega
            weight, bias = (
                torch.rand(fan_out, fan_in, generator=generator),
                torch.rand(fan_out, generator=generator),
            )
            self.weights.append((2 * weight - 1) * bound)
            self.biases.append((2 * bias - 1) / math.sqrt(fan_in))

    def forward(self, points):
        """Return the outputs at points (n, 3): Φ and Ψ (n, 4), or Φ alone (n, 1)."""
        return _Pass.apply(points, self.omega, False, *self.weights, *self.biases)[0]

    def forward_with_gradient(self, points):
        """Return the outputs, and ∇Φ (n, 3)."""
        return _Pass.apply(points, self.omega, True, *self.weights, *self.biases)


class _Pass(torch.autograd.Function):
    """The forward and backward passes. Inside, each column is a point: this layout is faster."""

    @staticmethod
    def forward(ctx, points, omega, with_gradient, *parameters):  # noqa: PLR0917 - called by torch
        count = len(parameters) // 2
        hidden = count - 1
        scaled = torch._foreach_mul([*parameters[:hidden], *parameters[count:-1]], omega)
        weights, biases = [*scaled[:hidden], parameters[hidden]], [*scaled[hidden:], parameters[-1]]
        h, turned = points.T.contiguous(), [weight.T.contiguous() for weight in weights]
        inputs, slopes, chains = [h], [], []
        for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
            h, slope = sines(product(weight, h), bias)
            slopes.append(slope)
            inputs.append(h)
        output = product(weights[-1], h).add_(biases[-1][:, None])
        gradient = None
        if with_gradient:
            # ∇Φ = W1ᵀ s1 · (W2ᵀ s2 · (… wΦ)), from the last layer to the first
            chain = weights[-1][0][:, None]
            for matrix, slope in zip(reversed(turned[:-1]), reversed(slopes), strict=True):
                chained = chain * slope
                chains.append((chain, chained))
                chain = product(matrix, chained)
            gradient = chain.T
        ctx.saved = omega, weights, turned, inputs, slopes, chains[::-1]
        return output.T, gradient

    @staticmethod
    def backward(ctx, to_output, to_gradient):
        omega, weights, turned, inputs, slopes, chains = ctx.saved
        count = len(weights)
        to_output = to_output.T.contiguous()
        to_weights, to_biases = [None] * count, [None] * count
        to_slopes, aside = [None] * (count - 1), Aside(to_output)
        to_weights[-1] = aside(product, to_output, inputs[-1].T)
        to_biases[-1] = aside(_row_sums, to_output)
        if to_gradient is not None:
            along = to_gradient.T.contiguous()
            for index, (weight, (chain, chained)) in enumerate(
                zip(weights[:-1], chains, strict=True)
            ):
                to_weights[index] = aside(product, chained, along.T)
                along = product(weight, along)
                to_slopes[index] = slopes_forward(along, chain, slopes[index])
            aside(_add_to_first, to_weights[-1], along)
        back = product(turned[-1], to_output)
        for index in reversed(range(count - 1)):
            slopes_back(back, slopes[index], to_slopes[index], sine=inputs[index + 1])
            to_weights[index] = aside(product, back, inputs[index].T, to_weights[index])
            to_biases[index] = aside(_row_sums, back)
            if index:
                back = product(turned[index], back)
        aside.join()
        torch._foreach_mul_([*to_weights[:-1], *to_biases[:-1]], omega)
        return None, None, None, *to_weights, *to_biases


def _row_sums(values):
    return values.sum(1)


def _add_to_first(matrix, values):
    matrix[0] += values.sum(1)

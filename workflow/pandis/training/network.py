"""The sine network in torch: Sitzmann et al. 2020, with the paper's four outputs."""

import itertools
import math

import torch


class Siren(torch.nn.Module):
    """x → sin(ω0·(W x + b)) … → (Φ, Ψ).

    Parameters
    ----------
    width : int
        Units per sine layer.
    depth : int
        Number of sine layers (SIREN's ``num_hidden_layers`` plus one).
    omega : float
        ω0.
    generator : torch.Generator
        Source of the initial weights.

    Notes
    -----
    Initialisation of SIREN's code: first layer U(±1/3), the others
    U(±sqrt(6 / width) / ω0), the last one included although nothing multiplies
    it by ω0; biases U(±1 / sqrt(fan-in)).
    """

    def __init__(self, width, depth, omega, generator):
        super().__init__()
        self.omega = omega
        sizes = [3, *[width] * depth, 4]
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
        """Return (n, 4): Φ and Ψ at points (n, 3)."""
        h = points
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = torch.sin(self.omega * torch.nn.functional.linear(h, weight, bias))
        return torch.nn.functional.linear(h, self.weights[-1], self.biases[-1])

    def forward_with_gradient(self, points):
        """Return (n, 4) and ∇Φ (n, 3).

        The gradient is the chain rule written out, last layer to first, so
        that a loss on it needs one backward pass and no double one.
        """
        h, slopes = points, []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            z = self.omega * torch.nn.functional.linear(h, weight, bias)
            h = torch.sin(z)
            slopes.append(self.omega * torch.cos(z))
        output = torch.nn.functional.linear(h, self.weights[-1], self.biases[-1])
        chain = self.weights[-1][:1].expand(len(points), -1)
        for weight, slope in zip(reversed(self.weights[:-1]), reversed(slopes), strict=True):
            chain = (chain * slope) @ weight
        return output, chain

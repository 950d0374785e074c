"""The paper's loss. Each of its seven terms is a function that averages over the points given.

Five of the terms apply only on the surface or only off it. SIREN's code sets them to zero at the
other points and averages over the whole batch. The paper does not say whether it does the same or
averages over only the points to which a term applies. The option ``weighting`` selects either.

Some printed formulas cannot be meant literally (see ``docs/architecture.md``). Inner products are
read as cosines, because raw products are unbounded below. ‖·‖ − 1 is read as its absolute value,
because otherwise a vanishing Ψ would be rewarded.
"""

import torch

from pandis.pipeline.kinds.network.training.tensors import (
    Loss,
    OffOutputs,
    OffVectors,
    Outputs,
    Vectors,
)
from pandis.pipeline.kinds.network.training.vectors import cosine, length


def eikonal(gradient):
    """Return Eq. 3, term 1: | ‖∇Φ‖ − 1 |."""
    return (length(gradient) - 1).abs().mean()


def normal_alignment(gradient, normal):
    """Return Eq. 3, term 2, on the surface: 1 − cos(∇Φ, n)."""
    return (1 - cosine(gradient, normal)).mean()


def surface(phi):
    """Return Eq. 3, term 3, on the surface: |Φ|."""
    return phi.abs().mean()


def off_surface(phi, alpha):
    """Return Eq. 3, term 4, off the surface: exp(−a |Φ|)."""
    # at 80 the result (1e-35) no longer matters, and float32 is not yet subnormal
    return torch.exp(-(alpha * phi.abs()).clamp(max=80.0)).mean()


def unit_length(psi):
    """Return Eq. 4, term 1: | ‖Ψ‖ − 1 |."""
    return (length(psi) - 1).abs().mean()


def psi_on_surface(psi, normal):
    """Return Eq. 4, term 2, on the surface: 1 − cos(Ψ, n)."""
    return (1 - cosine(psi, normal)).mean()


def psi_off_surface(psi, gradient):
    """Return Eq. 4, term 3, off the surface: 1 − cos(Ψ, ∇Φ)."""
    return (1 - cosine(psi, gradient)).mean()


def paper_loss(
    on: Outputs,
    on_gradient: Vectors,
    off: OffOutputs,
    *,
    off_gradient: OffVectors,
    normal: Vectors,
    options,
) -> Loss:
    """Return the paper's total loss, Eq. 5, with its seven weights.

    Parameters
    ----------
    on, off : Tensor, shape (n, 4) or (n, 1)
        (Φ, Ψ) on the surface and in the box; with Φ alone only the terms of Eq. 3 count.
    on_gradient, off_gradient : Tensor, shape (n, 3)
        ∇Φ at the same points.
    normal : Tensor, shape (n, 3)
        The mesh's normal at the surface points.
    options : pandis.pipeline.run.ask.recipes.PaperRecipe
        ``weights``, ``alpha``, ``stop_gradient``, ``weighting`` of
        `pandis.pipeline.run.ask.recipes.PaperRecipe`.
    """
    here, there = 1.0, 1.0
    if options.weighting == "batch":
        here, there = len(on) / (len(on) + len(off)), len(off) / (len(on) + len(off))
    gradient = torch.cat([on_gradient, off_gradient])
    terms = [
        eikonal(gradient),
        here * normal_alignment(on_gradient, normal),
        here * surface(on[:, 0]),
        there * off_surface(off[:, 0], options.alpha),
    ]
    if on.shape[1] > 1:
        target = off_gradient.detach() if options.stop_gradient else off_gradient
        terms += [
            unit_length(torch.cat([on[:, 1:], off[:, 1:]])),
            here * psi_on_surface(on[:, 1:], normal),
            there * psi_off_surface(off[:, 1:], target),
        ]
    weights = options.weights[: len(terms)]
    return sum(weight * term for weight, term in zip(weights, terms, strict=True))

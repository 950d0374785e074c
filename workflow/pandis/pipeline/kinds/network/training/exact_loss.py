"""The loss of the default recipe: regression on exact distance and normal."""

import torch

from pandis.pipeline.kinds.network.training.batches import answer
from pandis.pipeline.kinds.network.training.elements import fused
from pandis.pipeline.kinds.network.training.tensors import Loss, Numbers, Vectors
from pandis.pipeline.kinds.network.training.vectors import SMALL, length


def loss_of(outputs, rows, options):
    """Return the `exact_loss` of a network's outputs and gradient.

    On a GPU one kernel computes the loss and its gradient.
    """
    output, gradient = outputs
    if fused(output) is None:
        phi, direction = answer(output, gradient, rows)
        return exact_loss(phi, direction, rows[:, 3], normal=rows[:, 4:7], options=options)
    return _Regression.apply(output, gradient, rows, options)


class _Regression(torch.autograd.Function):
    @staticmethod
    def forward(ctx, output, gradient, rows, options):  # noqa: PLR0917 - called by torch
        kernels, n = fused(output), len(rows)
        output = output.T.contiguous()
        to_output, loss = torch.empty_like(output), output.new_empty(n)
        direction, to_direction = output[1:], to_output[1:]
        if gradient is not None:
            direction = gradient.T.contiguous()
            to_direction = torch.empty_like(direction)
        kernels.launch(
            kernels.regression, n, output[0], direction, rows, rows.shape[1] > 7, options.near,
            options.far, options.normal_weight, SMALL, loss, to_output[0], to_direction,
        )  # fmt: skip
        ctx.saved = to_output, None if gradient is None else to_direction
        return loss.mean()

    @staticmethod
    def backward(ctx, along):
        to_output, to_gradient = ctx.saved
        if to_gradient is not None:
            to_gradient = (to_gradient * along).T
        return (to_output * along).T, to_gradient, None, None


def exact_loss(
    phi: Numbers,
    direction: Vectors,
    distance: Numbers,
    *,
    normal: Vectors,
    options,
) -> Loss:
    """Return the regression loss on exact distance and normal.

    The force error at depth |d| is at most |Φ − d| + |d|·‖Ψ − n‖. Each part is an L1 loss, weighted
    towards the surface, where probes are. The weights have a lower bound, so that the network also
    learns the deep interior.

    Parameters
    ----------
    phi : Tensor, shape (n,)
    direction : Tensor, shape (n, 3)
        Ψ, or ∇Φ.
    distance : Tensor, shape (n,)
    normal : Tensor, shape (n, 3)
    options : pandis.pipeline.run.ask.recipes.ExactRecipe
        ``near``, ``far`` and ``normal_weight`` of `pandis.pipeline.run.ask.recipes.ExactRecipe`.
    """
    near, far = options.near, options.far
    weight = near / (near + distance.abs())
    off = weight.clamp(min=far) * (phi - distance).abs()
    turned = weight.clamp(min=far / 3) * length(direction - normal)
    return (off + options.normal_weight * turned).mean()

"""Steps of the optimisers: Adam, and Muon for the matrices between sine layers.

Muon (Jordan 2024; for sine networks McGinnis et al. 2025, arXiv 2512.14366): the
step is the momentum with all of its singular values set to one, so that all
directions of a matrix are trained equally.
"""

import torch

from pandis.pipeline.kinds.network.training.products import product

#: Coefficients of the quintic iteration that brings singular values near one (Jordan 2024).
_QUINTIC = (3.4445, -4.7750, 2.0315)
_ROUNDS = 5


def orthogonal(matrices):
    """Return matrices with the singular vectors of the given ones and singular values near one.

    Parameters
    ----------
    matrices : Tensor, shape (k, m, n)

    Returns
    -------
    Tensor, shape (k, m, n)
    """
    a, b, c = _QUINTIC
    x = matrices / (matrices.norm(dim=(1, 2), keepdim=True) + 1e-20)
    if x.is_cuda:  # half as many kernels and half the precision, as in Jordan's code
        x = x.bfloat16()
        for _ in range(_ROUNDS):
            square = torch.bmm(x, x.mT)
            mixed = torch.baddbmm(square, square, square, beta=b, alpha=c)
            x = torch.baddbmm(x, mixed, x, beta=a)
        return x.float()
    for _ in range(_ROUNDS):
        square = product(x, x.mT)
        x = a * x + product(b * square + c * product(square, square), x)
    return x


class Optimiser:
    """Adam on all parameters, or Adam on some and Muon on the hidden matrices.

    Parameters
    ----------
    network : pandis.pipeline.kinds.network.training.network.Siren
    learning_rate : float
        Adam's learning rate.
    matrix_rate : float or None
        Muon's learning rate, as a step of ω0·W; with None, Adam trains the matrices.
    """

    MOMENTUM = 0.95

    def __init__(self, network, learning_rate, matrix_rate):
        hidden = list(network.weights[1:-1]) if matrix_rate else []
        known = {id(p) for p in hidden}
        others = [p for p in network.parameters() if id(p) not in known]
        self.learning_rate = learning_rate
        self.matrix_rate = (matrix_rate or 0.0) / network.omega
        device = network.weights[0].device
        self.matrices = hidden
        self.momenta = [torch.zeros_like(p) for p in hidden]
        # a tensor, so that the rate of a recorded step can change
        graph = device.type == "cuda"
        rate = torch.tensor(0.0, device=device) if graph else 0.0
        self.share = torch.zeros((), device=device)
        self.adam = torch.optim.Adam(others, lr=rate, fused=True, capturable=graph)

    def set_share(self, share):
        """Set the step sizes to ``share`` times their largest values."""
        self.share.fill_(share)
        for group in self.adam.param_groups:
            if not torch.is_tensor(group["lr"]):
                group["lr"] = share * self.learning_rate

    @torch.no_grad()
    def step(self):
        """Take a step, using the gradients stored in the parameters."""
        for group in self.adam.param_groups:
            if torch.is_tensor(group["lr"]):  # so that a recorded step follows the share
                torch.mul(self.share, self.learning_rate, out=group["lr"])
        self.adam.step()
        if not self.matrices:
            return
        gradients = [matrix.grad for matrix in self.matrices]
        torch._foreach_lerp_(self.momenta, gradients, 1 - self.MOMENTUM)
        ahead = torch._foreach_lerp(gradients, self.momenta, self.MOMENTUM)
        steps = self.share * self.matrix_rate * orthogonal(torch.stack(ahead))
        torch._foreach_sub_(self.matrices, steps.unbind())

    def state(self):
        """Return the state that a checkpoint must store."""
        return {"adam": self.adam.state_dict(), "momenta": self.momenta}

    def restore(self, state):
        """Restore a `state`."""
        self.adam.load_state_dict(state["adam"])
        for momentum, stored in zip(self.momenta, state["momenta"], strict=True):
            momentum.copy_(stored)

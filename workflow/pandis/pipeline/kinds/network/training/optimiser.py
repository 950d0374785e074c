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
#: Names of what Adam stores for each parameter.
_STATE = "step", "exp_avg", "exp_avg_sq"


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


class _Adam:
    """The steps of ``torch.optim.Adam(fused=True)``, bit for bit.

    That class imports torch's compiler, which takes seconds, longer than a short training on a GPU.
    Its kernel is private: tried with torch 2.11 (CUDA) and 2.13 (CPU).
    """

    def __init__(self, parameters, device):
        self.parameters = parameters
        self.means, self.squares = ([torch.zeros_like(p) for p in parameters] for _ in range(2))
        self.steps = [torch.zeros((), device=device) for _ in parameters]
        # on a GPU a tensor, so that the rate of a recorded step can change
        self.rate = torch.zeros((), device=device) if device.type == "cuda" else 0.0

    def step(self, share, learning_rate):
        """Take a step of ``share`` times the learning rate."""
        if torch.is_tensor(self.rate):
            torch.mul(share, learning_rate, out=self.rate)
        torch._foreach_add_(self.steps, 1)
        torch._fused_adam_(
            self.parameters, [p.grad for p in self.parameters], self.means, self.squares, [],
            self.steps, lr=self.rate, beta1=0.9, beta2=0.999, weight_decay=0.0, eps=1e-8,
            amsgrad=False, maximize=False,
        )  # fmt: skip

    def state(self):
        """Return the state, in the form of ``torch.optim.Adam``."""
        rows = zip(self.steps, self.means, self.squares, strict=True)
        return {"state": {i: dict(zip(_STATE, row, strict=True)) for i, row in enumerate(rows)}}

    def restore(self, state):
        """Restore a `state`."""
        for index, row in enumerate(zip(self.steps, self.means, self.squares, strict=True)):
            for key, current in zip(_STATE, row, strict=True):
                current.copy_(state["state"][index][key])


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
        self.share = torch.zeros((), device=device)
        self.adam = _Adam(others, device)

    def set_share(self, share):
        """Set the step sizes to ``share`` times their largest values."""
        self.share.fill_(share)
        if not torch.is_tensor(self.adam.rate):
            self.adam.rate = share * self.learning_rate

    @torch.no_grad()
    def step(self):
        """Take a step, using the gradients stored in the parameters."""
        self.adam.step(self.share, self.learning_rate)
        if not self.matrices:
            return
        gradients = [matrix.grad for matrix in self.matrices]
        torch._foreach_lerp_(self.momenta, gradients, 1 - self.MOMENTUM)
        ahead = torch._foreach_lerp(gradients, self.momenta, self.MOMENTUM)
        steps = self.share * self.matrix_rate * orthogonal(torch.stack(ahead))
        torch._foreach_sub_(self.matrices, steps.unbind())

    def state(self):
        """Return the state that a checkpoint must store."""
        return {"adam": self.adam.state(), "momenta": self.momenta}

    def restore(self, state):
        """Restore a `state`."""
        self.adam.restore(state["adam"])
        for momentum, stored in zip(self.momenta, state["momenta"], strict=True):
            momentum.copy_(stored)

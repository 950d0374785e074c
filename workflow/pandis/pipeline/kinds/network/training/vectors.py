"""Lengths and cosines whose gradients stay finite at zero."""

import torch

#: Length below which a direction counts as undefined. It keeps cosines smooth.
SMALL = 1e-4


def length(vectors):
    """Return the norm of vectors (n, 3), differentiable at zero."""
    return torch.sqrt((vectors * vectors).sum(dim=1) + SMALL * SMALL)


def cosine(a, b):
    """Return the cosine of the angle between vectors (n, 3); 0 where one of them vanishes."""
    return (a * b).sum(dim=1) / (length(a) * length(b))

"""Shapes of tensors, for signatures: see `pandis.base.arrays`."""

import torch
from jaxtyping import Float

#: A number for each of n points.
Numbers = Float[torch.Tensor, " n"]
#: A vector for each of n points.
Vectors = Float[torch.Tensor, "n 3"]
#: Vectors at m other points, off the surface.
OffVectors = Float[torch.Tensor, "m 3"]
#: The k outputs of a network at n points on the surface.
Outputs = Float[torch.Tensor, "n k"]
#: The k outputs at m points off the surface.
OffOutputs = Float[torch.Tensor, "m k"]
#: A scalar loss.
Loss = Float[torch.Tensor, ""]

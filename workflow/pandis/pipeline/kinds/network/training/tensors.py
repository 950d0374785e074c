"""Shapes of tensors, for signatures: see `pandis.base.arrays`."""

import torch
from jaxtyping import Float

#: A number, and a vector, for each of n points.
Numbers = Float[torch.Tensor, " n"]
Vectors = Float[torch.Tensor, "n 3"]
#: Vectors at m other points, off the surface.
OffVectors = Float[torch.Tensor, "m 3"]
#: The k outputs of a network at n points on the surface, and at m off it.
Outputs = Float[torch.Tensor, "n k"]
OffOutputs = Float[torch.Tensor, "m k"]
#: A scalar loss.
Loss = Float[torch.Tensor, ""]

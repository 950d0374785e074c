"""The loss of the default recipe: regression on exact distance and normal."""

from pandis.training.tensors import Loss, Numbers, Vectors
from pandis.training.vectors import length


def exact_loss(
    phi: Numbers,
    direction: Vectors,
    distance: Numbers,
    normal: Vectors,
    options,
) -> Loss:
    """Return the regression loss on exact distance and normal.

    The force error of a point at depth |d| is at most |Φ − d| + |d|·‖Ψ − n‖;
    both parts are of L1 kind and weighted toward the surface, where probes are; far from
    it the weights have a floor, so that what is deep inside is learnt, too.

    Parameters
    ----------
    phi : Tensor, shape (n,)
    direction : Tensor, shape (n, 3)
        Ψ, or ∇Φ.
    distance : Tensor, shape (n,)
    normal : Tensor, shape (n, 3)
    options : pandis.run.recipes.ExactRecipe
        ``near``, ``far`` and ``normal_weight`` of `pandis.run.recipes.ExactRecipe`.
    """
    near, far = options.near, options.far
    weight = near / (near + distance.abs())
    off = weight.clamp(min=far) * (phi - distance).abs()
    turned = weight.clamp(min=far / 3) * length(direction - normal)
    return (off + options.normal_weight * turned).mean()

"""The loss of the default recipe: regression on exact distance and normal."""

from pandis.training.vectors import length


def exact_loss(phi, direction, distance, normal, options):
    """Return the regression loss on exact distance and normal.

    The force error of a point at depth |d| is at most |Φ − d| + |d|·‖Ψ − n‖;
    both parts are of L1 kind and weighted toward the surface, where probes are.

    Parameters
    ----------
    phi : Tensor, shape (n,)
    direction : Tensor, shape (n, 3)
        Ψ, or ∇Φ.
    distance : Tensor, shape (n,)
    normal : Tensor, shape (n, 3)
    options : dict
        ``near`` and ``normal_weight`` of `pandis.config.ExactRecipe`.
    """
    weight = options["near"] / (options["near"] + distance.abs())
    error = (phi - distance).abs() + options["normal_weight"] * length(direction - normal)
    return (weight * error).mean()

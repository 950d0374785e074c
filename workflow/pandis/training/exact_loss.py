"""The loss of the default recipe: regression on exact distance and normal."""

from pandis.training.vectors import length


def exact_loss(output, distance, normal, options):
    """Return the regression loss on exact distance and normal.

    The force error of a point at depth |d| is at most |Φ − d| + |d|·‖Ψ − n‖;
    both parts are of L1 kind and weighted toward the surface, where probes are.

    Parameters
    ----------
    output : Tensor, shape (n, 4)
    distance : Tensor, shape (n,)
    normal : Tensor, shape (n, 3)
    options : dict
        ``near`` and ``normal_weight`` of `pandis.config.ExactRecipe`.
    """
    weight = options["near"] / (options["near"] + distance.abs())
    error = (output[:, 0] - distance).abs()
    error = error + options["normal_weight"] * length(output[:, 1:] - normal)
    return (weight * error).mean()

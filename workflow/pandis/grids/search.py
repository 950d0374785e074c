"""Grids asked for by what they should achieve: the coarsest that meets an error, the finest
that fits into a budget of bytes."""

import numpy as np

from pandis.errors import PandisError
from pandis.forces import penalty_force

#: Sizes that are tried, coarse to fine.
SIZES = (16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)


def force_error(field, points, force):
    """Return the mean error of the force of a field (unit frame, k = 1)."""
    return float(np.linalg.norm(penalty_force(*field.answer(points)) - force, axis=1).mean())


def coarsest(candidates, measure, wanted, what):
    """Find the first candidate that meets an error, by halving.

    Errors fall along the candidates but for noise; the one that is returned was measured,
    and so was the one before it.

    Parameters
    ----------
    candidates : sequence
        From cheap to dear.
    measure : callable
        Returns the error of a candidate.
    wanted : float
    what : str
        What is being sized, for the message.

    Returns
    -------
    candidate, errors : object, dict
        The choice, and the error of every candidate that was measured.

    Raises
    ------
    PandisError
        Not even the dearest candidate meets it.
    """
    errors = {}
    low, high = 0, len(candidates) - 1
    errors[candidates[high]] = measure(candidates[high])
    if errors[candidates[high]] > wanted:
        raise PandisError(
            f"{what}: no size meets the mean force error of {wanted:g} asked for; the largest, "
            f"{candidates[high]:,}, has {errors[candidates[high]]:.3g}: ask for less, or for "
            "another kind of field"
        )
    while low < high:
        middle = (low + high) // 2
        errors[candidates[middle]] = measure(candidates[middle])
        if errors[candidates[middle]] <= wanted:
            high = middle
        else:
            low = middle + 1
    return candidates[high], errors

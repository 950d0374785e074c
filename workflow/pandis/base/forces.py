"""The penalty law: Eq. 6 of the paper, clamped so that contacts only push."""

import numpy as np

from pandis.base.arrays import Points, Values


def penalty_force(distance: Values, normal: Points, stiffness=1.0) -> Points:
    """Return F = -k · min(distance, 0) · normal.

    Parameters
    ----------
    distance : ndarray, shape (n,), negative inside
    normal : ndarray, shape (n, 3), outward
    stiffness : float
        k, in units of force per unit of ``distance``.

    Returns
    -------
    ndarray, shape (n, 3)
        Zero outside, since a contact never pulls; also zero where the distance is NaN.
    """
    inside = np.less(distance, 0.0)  # false for NaN
    depth = np.where(inside, -stiffness * np.asarray(distance), 0.0)
    return np.where(inside[:, None], depth[:, None] * normal, 0.0)


def force_of(field):
    """Return a function that maps points (n, 3) to a field's forces (n, 3); unit frame, k = 1."""
    return lambda points: penalty_force(*field.answer(points))

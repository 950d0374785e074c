"""How steep the force is: the largest singular value of dF/dx, against the wall's own stiffness."""

import numpy as np

from pandis.forces import penalty_force

#: A wall that is more than so many times as stiff as asked for is felt as an edge.
STEEP = 2.0
#: Points with one that the exact force has not.
ALLOWED = 0.005


def jacobians(answer, points, step):
    """Return dF/dx (n, 3, 3) by central differences over ``step``, k = 1, unit frame."""
    moves = np.concatenate([step / 2 * np.eye(3), -step / 2 * np.eye(3)])
    force = penalty_force(*answer((points[:, None] + moves).reshape(-1, 3))).reshape(-1, 2, 3, 3)
    return ((force[:, 0] - force[:, 1]) / step).transpose(0, 2, 1)


def stiffness(answer, exact, points, scale, device):
    """Measure the local stiffness over a step of the encoder.

    Parameters
    ----------
    answer, exact : callable
        Answer (distance, normal) at points (n, 3), unit frame.
    points : ndarray, shape (n, 3)
    scale, device
        See `pandis.stress.physical`.

    Returns
    -------
    dict
        ``p50_n_m``, ``p99_n_m``, ``max_n_m``: largest singular value of dF/dx; ``steep``: share
        of points above STEEP times k; ``asymmetry``: mean ‖J − Jᵀ‖ / ‖J‖, zero of a force that
        is a gradient; ``limit``: allowed share of steep points; ``passed``.
    """
    step = device.encoder * scale.metre
    found, wanted = (jacobians(a, points, step) for a in (answer, exact))
    largest, reference = (np.linalg.norm(j, ord=2, axis=(1, 2)) for j in (found, wanted))
    size = np.linalg.norm(found, axis=(1, 2))
    odd = np.linalg.norm(found - found.transpose(0, 2, 1), axis=(1, 2))
    steep = float((largest > STEEP).mean())
    limit = float((reference > STEEP).mean()) + ALLOWED
    p50, p99 = np.percentile(largest, [50, 99]) * scale.stiffness
    return {
        "p50_n_m": float(p50),
        "p99_n_m": float(p99),
        "max_n_m": float(largest.max() * scale.stiffness),
        "steep": steep,
        "asymmetry": float((odd / np.maximum(size, 1e-12)).mean()),
        "limit": limit,
        "passed": steep <= limit,
    }

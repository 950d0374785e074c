"""Tests how steep the force is: the largest singular value of dF/dx, compared with k."""

import numpy as np

from pandis.base.arrays import Matrices, Points
from pandis.base.forces import penalty_force
from pandis.pipeline.judge.stress.probes import excess

#: A wall that is stiffer than this multiple of the requested stiffness feels like an edge.
STEEP = 2.0
#: Largest share of the area on which walls may exceed STEEP although the exact ones do not.
ALLOWED = 0.01
#: The force of a smooth field may change in one step by as much as the exact force in this many.
NEARBY = 20


def jacobians(answer, points: Points, step) -> Matrices:
    """Return dF/dx (n, 3, 3) by central differences over ``step``, k = 1, unit frame."""
    moves = np.concatenate([step / 2 * np.eye(3), -step / 2 * np.eye(3)])
    force = penalty_force(*answer((points[:, None] + moves).reshape(-1, 3))).reshape(-1, 2, 3, 3)
    return ((force[:, 0] - force[:, 1]) / step).transpose(0, 2, 1)


def stiffness(answer, exact, shell, *, scale, device):
    """Measure the local stiffness over a step of the encoder.

    Parameters
    ----------
    answer, exact : callable
        Return (distance, normal) at points (n, 3), unit frame.
    shell : pandis.pipeline.judge.stress.probes.Shell
    scale : pandis.base.physical.Scale
    device : pandis.pipeline.judge.stress.physical.Device

    Returns
    -------
    dict
        ``p50_n_m``, ``p99_n_m``, ``max_n_m``: median, 99th percentile and maximum of the largest
        singular value of dF/dx; ``steep``: share of the area where it is above STEEP times k, and
        above the value that the exact force would have if all of its change nearby came in one
        step; ``asymmetry``: mean ‖J − Jᵀ‖ / ‖J‖, zero if the force is a gradient; ``limit``,
        ``passed``.
    """
    step = device.encoder * scale.metre
    slopes = jacobians(answer, shell.points, step)
    largest, here, nearby = (
        np.linalg.norm(j, ord=2, axis=(1, 2))
        for j in (slopes, *(jacobians(exact, shell.points, s) for s in (step, NEARBY * step)))
    )
    reference = np.maximum(here, NEARBY * nearby - (NEARBY - 1))
    size = np.linalg.norm(slopes, axis=(1, 2))
    odd = np.linalg.norm(slopes - slopes.transpose(0, 2, 1), axis=(1, 2))
    steep = excess(largest, reference, STEEP, weight=shell.weight)
    p50, p99 = np.percentile(largest, [50, 99]) * scale.stiffness
    return {
        "p50_n_m": float(p50),
        "p99_n_m": float(p99),
        "max_n_m": float(largest.max() * scale.stiffness),
        "steep": steep,
        "asymmetry": float((odd / np.maximum(size, 1e-12)).mean()),
        "limit": ALLOWED,
        "passed": steep <= ALLOWED,
    }

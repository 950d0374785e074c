"""The comparison that an export must pass before it is written."""

import numpy as np

from pandis.errors import PandisError
from pandis.forces import penalty_force

POINTS = 10_000
#: Bounds in the unit frame.
DISTANCE, FORCE = 5e-6, 5e-6


def check_points(frame, seed=0):
    """Return points (n, 3) in mesh units: three quarters in the box, the rest around it."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-1, 1, (POINTS, 3))
    unit[::4] *= 3
    return frame.to_mesh(unit)


def check(answer, reference, frame):
    """Compare an exported model with its field.

    Parameters
    ----------
    answer : callable
        The exported model: distance and normal, float32, mesh units, at points in mesh units.
    reference : callable
        Answers (distance, normal, certainty) in the unit frame at points in the unit frame;
        ``certainty`` (n,) is ‖Ψ‖ of a network, 1 for others: below 0.1 the direction is
        rounding noise, and the force is not compared.
    frame : Frame

    Returns
    -------
    dict
        Largest differences of distance and force, unit frame.

    Raises
    ------
    PandisError
        They differ by more than the bounds, or something is not finite.
    """
    points = check_points(frame)
    distance, normal = answer(points)
    wanted_distance, wanted_normal, certainty = reference(frame.to_unit(points))
    force = penalty_force(distance.astype(np.float64) * frame.scale, normal)
    wanted_force = penalty_force(wanted_distance, wanted_normal)
    differences = {
        "distance": float(np.abs(distance * frame.scale - wanted_distance).max()),
        "force": float((np.linalg.norm(force - wanted_force, axis=1) * (certainty >= 0.1)).max()),
        "length": float(np.abs(np.linalg.norm(normal, axis=1) - 1).max()),
    }
    bounds = {"distance": DISTANCE, "force": FORCE, "length": 1e-5}
    for key, bound in bounds.items():
        if not differences[key] <= bound:  # NaN fails too
            raise PandisError(
                f"the exported model differs from its field: {key} by {differences[key]:.3g}, "
                f"allowed is {bound:.3g}; this is a defect of the export: please report it"
            )
    return differences

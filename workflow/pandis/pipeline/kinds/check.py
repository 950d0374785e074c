"""The comparison that an export must pass before it is written."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT

POINTS = 100_000
#: Bounds in the unit frame. Forces are compared where the direction's length before normalisation
#: is at least 0.1, normals where it is at least 0.5: rounding rotates shorter directions too far.
#: Errors of the normal are multiplied by that length, because the angle by which rounding rotates a
#: direction is inversely proportional to the length.
DISTANCE, FORCE, NORMAL = 5e-6, 5e-6, 2e-5
FORCE_LENGTH, NORMAL_LENGTH = 0.1, 0.5


def check_points(frame, seed=0):
    """Return points (n, 3) in mesh units: three quarters in the box, the rest around it."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-1, 1, (POINTS, 3))
    unit[::4] *= 3
    return frame.to_mesh(unit)


def check(answer, reference, frame, *, rounding=1.0, left_out=None, double=None):
    """Compare an exported model with its field.

    Parameters
    ----------
    answer : callable
        The exported model. Returns distance and normal, float32, at points, all in mesh units.
    reference : callable
        Returns (distance, normal, length) at points, all in the unit frame. ``length`` (n,) is
        the length of the direction before normalisation: ‖Ψ‖ for a network.
    frame : Frame
    rounding : float
        Factor on the force bound: a direction computed from differences loses digits.
    left_out : callable, optional
        Returns a mask (n,) of the points (n, 3), in mesh units, that are not compared.
    double : callable, optional
        The reference in double precision, which differs from ``reference`` only by rounding. A
        bound below twice that difference is raised to that value.

    Returns
    -------
    dict
        Largest differences of distance, force and normal, unit frame; and of the
        normal's length from 1.

    Raises
    ------
    PandisError
        A difference exceeds its bound, or is not finite.
    """
    points = check_points(frame)
    if left_out is not None:
        points = points[~left_out(points)]
    distance, normal = answer(points)
    expected = reference(frame.to_unit(points))
    distance = distance.astype(np.float64) * frame.scale
    differences = _differences((distance, normal), expected)
    bounds = {"distance": DISTANCE, "force": FORCE * rounding, "normal": NORMAL, "length": 1e-5}
    if double is not None and any(not differences[key] <= bounds[key] for key in bounds):
        rounding_off = _differences(expected[:2], double(frame.to_unit(points)))
        bounds = {key: max(bound, 2 * rounding_off[key]) for key, bound in bounds.items()}
    return _within(differences, bounds)


def _differences(answer, expected):
    """Return the largest difference of each quantity (unit frame)."""
    (distance, normal), (expected_distance, expected_normal, length) = answer, expected
    force = penalty_force(distance, normal)
    force_off = np.linalg.norm(force - penalty_force(expected_distance, expected_normal), axis=1)
    normal_off = np.linalg.norm(normal - expected_normal, axis=1)
    return {
        "distance": float(np.abs(distance - expected_distance).max()),
        "force": float((force_off * (length >= FORCE_LENGTH)).max()),
        "normal": float((normal_off * np.minimum(length, 1) * (length >= NORMAL_LENGTH)).max()),
        "length": float(np.abs(np.linalg.norm(normal, axis=1) - 1).max()),
    }


def check_nearest(field, engine, rounding):
    """Check that a field's distances and normals lead to closest points of a surface.

    Normals are not compared: where several faces are equally near, the normal of any is right.

    Parameters
    ----------
    field : pandis.pipeline.kinds.exported.ExportedField
    engine : pandis.pipeline.geometry.distance.MeshDistance
        The exact distance of the surface.
    rounding : float
        Amount by which a distance may be too large (unit frame).

    Returns
    -------
    dict
        ``distance``: largest error of the distance. ``side``: number of points that are farther
        than ``rounding`` from the surface and whose side contradicts the winding number. ``cut``:
        largest error of the bounds of cut queries. ``foot``: largest distance of a computed closest
        point from the surface. ``length``: largest difference of the normal's length from 1.

    Raises
    ------
    PandisError
        One of these exceeds its bound, or is not finite.
    """
    points = check_points(UNIT)
    distance, normal, _ = field.query(points)
    exact, _ = engine.distance_and_normal(points, check=False)
    clear = field.clear(points)
    cut = clear < np.abs(distance)  # outside the box, flags do not show this
    foot, _ = engine.distance_and_normal(points - distance[:, None] * normal, check=False)
    far = np.abs(exact) > rounding
    differences = {
        "distance": float(np.abs(np.abs(distance) - np.abs(exact))[~cut].max()),
        "side": float((engine.inside(points) != (distance < 0))[far].sum()),
        # the exact distance is between the clear radius and the returned distance
        "cut": float(np.maximum(clear - np.abs(exact), np.abs(exact) - np.abs(distance)).max()),
        "foot": float(np.abs(foot).max()),
        "length": float(np.abs(np.linalg.norm(normal, axis=1) - 1).max()),
    }
    bounds = {"distance": rounding, "side": 0.0, "cut": rounding, "foot": 1e-9, "length": 1e-9}
    return _within(differences, bounds)


def _within(differences, bounds):
    for key, bound in bounds.items():
        if not differences[key] <= bound:  # NaN fails too
            raise PandisError(
                f"the exported model differs from its field: {key} by {differences[key]:.3g}, "
                f"more than {bound:.3g}; this is a defect of the export: please report it"
            )
    return differences

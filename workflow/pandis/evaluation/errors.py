"""The force error of every field against the exact force."""

import numpy as np

from pandis.forces import penalty_force

#: Ending of the row with the paper's own force, in which Ψ keeps its length.
UNNORMALISED = " (‖Ψ‖ kept)"


def statistics(force, exact):
    """Summarise the error of forces against exact ones.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3)

    Returns
    -------
    dict of str to float
        mean, rms, p95, p99, max of ‖F − F_exact‖; ``eq7``: the paper's Eq. 7 as
        printed, Σ ‖·‖ / j, which weights the first samples most; and ``angle``:
        the mean angle in degrees between the two where both push.
    """
    error = np.linalg.norm(force - exact, axis=1)
    lengths = np.linalg.norm(force, axis=1), np.linalg.norm(exact, axis=1)
    both = (lengths[0] > 0) & (lengths[1] > 0)
    directions = [f[both] / n[both, None] for f, n in zip((force, exact), lengths, strict=True)]
    chord = np.linalg.norm(directions[0] - directions[1], axis=1)
    angle = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))
    return {
        "mean": float(error.mean()),
        "rms": float(np.sqrt((error**2).mean())),
        "p95": float(np.percentile(error, 95)),
        "p99": float(np.percentile(error, 99)),
        "max": float(error.max()),
        "eq7": float((error / np.arange(1, len(error) + 1)).sum()),
        "angle": float(angle.mean()) if len(angle) else 0.0,
    }


def evaluate(fields, trajectory, probe_sets, progress):
    """Compare all fields on the trajectory and on the probe sets.

    Parameters
    ----------
    fields : list of pandis.fields.base.Field
    trajectory : tuple (points, distance, normal)
        Exact, unit frame.
    probe_sets : dict of str to tuple
        Likewise.
    progress : callable
        Makes a `pandis.stage.Progress`.

    Returns
    -------
    arrays, attributes : dict
        As stored in ``evaluation.zarr.zip``. Forces are of the unit frame at k = 1.
    """
    sets = {"trajectory": trajectory} | probe_sets
    arrays, errors, scale = {}, {name: {} for name in sets}, {}
    report = progress("fields", len(fields), "fields")
    for name, (_, distance, normal) in sets.items():
        exact = penalty_force(distance, normal)
        scale[name] = float(np.linalg.norm(exact, axis=1).mean())
    for index, field in enumerate(fields):
        for name, (points, distance, normal) in sets.items():
            if field.ordered and name != "trajectory":
                continue  # its points are no path
            exact = penalty_force(distance, normal)
            force = penalty_force(*field.answer(points))
            errors[name][field.name] = statistics(force, exact)
            if name == "trajectory":
                arrays[f"force_{field.name}"] = force
            if hasattr(field, "raw"):
                phi, psi = field.raw(points)
                kept = penalty_force(phi.astype(np.float64), psi.astype(np.float64))
                errors[name][field.name + UNNORMALISED] = statistics(kept, exact)
        report.update(index + 1)
    points, distance, normal = trajectory
    arrays["exact_force"] = penalty_force(distance, normal)
    return arrays, {
        "fields": [field.name for field in fields],
        "errors": errors,
        "mean_force": scale,
        "bytes": {field.name: int(field.bytes) for field in fields},
        "force_unit": "unit frame, k = 1",
    }

"""Measures the error of every field's force against the exact one."""

import numpy as np

from pandis.base.arrays import Points
from pandis.base.forces import force_of, penalty_force
from pandis.pipeline.geometry.measure import contact_errors
from pandis.pipeline.geometry.shares import MISSING_LIMIT, Probes, shares
from pandis.pipeline.judge.controls import demand_failure

#: Suffix of the row for the paper's force, in which Ψ is not normalised.
UNNORMALISED = " (‖Ψ‖ kept)"


def statistics(force: Points, exact: Points):
    """Summarise the error of forces against exact ones.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3)

    Returns
    -------
    dict of str to float
        mean, rms, p95, p99, max of ‖F − F_exact‖; ``eq7``: the paper's Eq. 7 as
        printed, Σ ‖·‖ / j, which weights the first samples most; and ``angle``:
        the mean angle in degrees between the two forces, where neither is zero.
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


def evaluate(fields, controls, trajectory, *, probe_sets, contacts, progress):
    """Compare all fields with the exact one on the trajectory, probe sets and contact sets.

    Parameters
    ----------
    fields : list of pandis.pipeline.kinds.field.Field
    controls : list of pandis.pipeline.kinds.field.Field
        Also measured on the contact sets: see `pandis.pipeline.judge.controls`.
    trajectory : tuple (points, distance, normal)
        Exact, unit frame.
    probe_sets : dict of str to tuple
        By name: points, distance and normal, also exact, unit frame.
    contacts : pandis.pipeline.geometry.measure.ContactSet
    progress : pandis.base.progress.Progress

    Returns
    -------
    arrays, attributes : dict
        As stored in ``evaluation.zarr.zip``. Forces are in the unit frame at k = 1. ``errors``: by
        set and field; on the trajectory and the contact sets they include the shares of
        `pandis.pipeline.geometry.shares.shares`. ``controls``: by control and contact set.
    """
    sets = {"trajectory": trajectory} | probe_sets
    arrays, scale = {}, {}
    errors = {name: {} for name in (*sets, *contacts.sets)}
    report = progress("fields", len(fields), "fields")
    for name, exact in _exact_forces(sets, contacts):
        scale[name] = float(np.linalg.norm(exact, axis=1).mean()) if len(exact) else 0.0
    for index, field in enumerate(fields):
        for name, (points, distance, normal) in sets.items():
            if field.ordered and name != "trajectory":
                continue  # an ordered field requires a path
            exact = penalty_force(distance, normal)
            force = penalty_force(*field.answer(points))
            errors[name][field.name] = statistics(force, exact)
            if name == "trajectory":
                arrays[f"force_{field.name}"] = force
                errors[name][field.name] |= _path_shares(force, trajectory, contacts)
            if field.keeps_length:
                unnormalised = _unnormalised(field)(points)
                errors[name][field.name + UNNORMALISED] = statistics(unnormalised, exact)
        if not field.ordered:
            forces = {field.name: force_of(field)}
            if field.keeps_length:
                forces[field.name + UNNORMALISED] = _unnormalised(field)
            for name, force_at in forces.items():
                for contact, figures in contact_errors(force_at, contacts).items():
                    errors[contact][name] = figures
        report.update(index + 1)
    points, distance, normal = trajectory
    arrays["exact_force"] = penalty_force(distance, normal)
    return arrays, {
        "controls": measured_controls(controls, contacts),
        "contact": {"left_out": contacts.left_out},
        "fields": [field.name for field in fields],
        "errors": errors,
        "mean_force": scale,
        "bytes": {field.name: int(field.bytes) for field in fields},
        "force_unit": "unit frame, k = 1",
    }


def measured_controls(controls, contacts):
    """Return the errors of control fields on the contact sets, by name.

    Raises
    ------
    PandisError
        The measure of missing surface passes a control.
    """
    tried = {control.name: contact_errors(force_of(control), contacts) for control in controls}
    demand_failure(
        "the measure of missing surface",
        (name for name, figures in tried.items()
         if all(one["missing"] <= MISSING_LIMIT for one in figures.values())),
    )  # fmt: skip
    return tried


def _unnormalised(field):
    """Return a function that computes the paper's force, in which Ψ is not normalised."""

    def force(points):
        phi, psi = field.direction(points)
        return penalty_force(phi.astype(np.float64), psi.astype(np.float64))

    return force


def _exact_forces(sets, contacts):
    """Yield the name and the exact forces of every set."""
    for name, (_, distance, normal) in sets.items():
        yield name, penalty_force(distance, normal)
    for name, probes in contacts.sets.items():
        yield name, probes.force


def _path_shares(force, trajectory, contacts):
    """Return the mean error on a path, relative and in newtons, and its shares (see `shares`)."""
    pressed, nowhere = contacts.pressed, np.zeros(len(force), bool)
    probes = Probes(*trajectory, nowhere, pressed.scale, pressed.engine)
    mean = float(np.linalg.norm(force - probes.force, axis=1).mean())
    size = float(np.linalg.norm(probes.force, axis=1).mean())
    relative = {"relative": mean / max(size, 1e-300), "newtons": mean * pressed.scale.newtons}
    return relative | shares(force, probes)

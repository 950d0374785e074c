"""How the force changes along short lines through the contact shell.

An exact force has no error, and yet it jumps wherever the closest facet changes; a device shows
that as a click. A wall of stiffness k changes the force by k·h over a step h at most, whatever
its shape, except where the normal turns: what changes it by a multiple of that is felt as an
edge, or is a defect of the field.
"""

import numpy as np

from pandis.forces import penalty_force
from pandis.geometry.frame import UNIT_SIDE
from pandis.geometry.sampling import PROBE_DEPTHS
from pandis.streams import SMOOTHNESS, generator

#: Length of a line (m, in the device's workspace), and its steps.
LENGTH, STEPS = 1e-3, 100
#: A step over which the force changes by more than so many times k·h is a jump.
JUMP = 5.0
#: The exact field, in the table, where it is not among the fields.
REFERENCE = "exact"


def line_probes(surface, count, size, seed):
    """Return short straight lines that cross the contact shell.

    Parameters
    ----------
    surface : pandis.geometry.sampling.Surface
    count : int
    size : float
        Metres of the object's longest side in the device's workspace.
    seed : int

    Returns
    -------
    ndarray, shape (count, STEPS + 1, 3), unit frame
        Points at equal distances. Lines have their middles 0 to 0.04 below the surface and
        every direction.
    """
    rng = generator(seed, SMOOTHNESS)
    points, normals, _, _ = surface.draw(count, rng)
    middle = points - rng.uniform(0, PROBE_DEPTHS["deep"], count)[:, None] * normals
    along = rng.normal(size=(count, 3))
    along *= UNIT_SIDE * LENGTH / size / np.linalg.norm(along, axis=1, keepdims=True)
    place = np.linspace(-0.5, 0.5, STEPS + 1)
    return middle[:, None] + place[:, None] * along[:, None]


def force_steps(answer, lines):
    """Return by how much the force changes over every step, in units of k times the step.

    Parameters
    ----------
    answer : callable
        Answers (distance, normal) at points (n, 3), unit frame.
    lines : ndarray, shape (m, s + 1, 3)

    Returns
    -------
    ndarray, shape (m, s)
    """
    force = penalty_force(*answer(lines.reshape(-1, 3))).reshape(lines.shape)
    step = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    return np.linalg.norm(np.diff(force, axis=1), axis=2) / step[:, None]


def smoothness(fields, engine, lines):
    """Compare the jumps of all fields with those of the exact force.

    Parameters
    ----------
    fields : list of pandis.fields.base.Field
    engine : object
        The exact distance of a `pandis.geometry.body.Body`.
    lines : ndarray, shape (m, s + 1, 3)

    Returns
    -------
    dict of str to dict
        By field: ``largest``, ``p999`` and ``rms`` of the change of force per step, in units of
        k times the step; ``jumps``, the share of steps above `JUMP`, and ``of_exact``, the
        largest as a share of the exact field's.
    """
    answers = {REFERENCE: engine.distance_and_normal}
    answers |= {field.name: field.answer for field in fields if not field.ordered}
    table = {}
    for name, answer in answers.items():
        change = force_steps(answer, lines)
        table[name] = {
            "largest": float(change.max()),
            "p999": float(np.percentile(change, 99.9)),
            "rms": float(np.sqrt((change**2).mean())),
            "jumps": float((change > JUMP).mean()),
        }
    for row in table.values():
        row["of_exact"] = row["largest"] / max(table[REFERENCE]["largest"], 1e-300)
    return table

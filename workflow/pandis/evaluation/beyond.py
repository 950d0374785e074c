"""What fields do beyond the contact shell: in free space, and deeper than they were made for."""

import numpy as np

from pandis.forces import penalty_force
from pandis.geometry.sampling import PROBE_DEPTHS
from pandis.streams import BEYOND, generator

POINTS = 50_000


def beyond(fields, engine, seed):
    """Look for contacts where there are none, and for their absence inside.

    Parameters
    ----------
    fields : list of pandis.fields.base.Field
    engine : object
        The exact distance of a `pandis.geometry.body.Body`.
    seed : int

    Returns
    -------
    dict of str to dict
        By field, of points uniform in the box [-1, 1]³: ``ghost``, the largest force outside of
        the shape, and ``ghosts``, the share of such points with one; ``missed``, the share of
        points inside with no force; ``core``, the mean error of the force at points deeper than
        the deep probes as a share of the mean force there (None where no part is so thick).
        Fields that need a path are left out.
    """
    points = generator(seed, BEYOND).uniform(-1, 1, (POINTS, 3))
    distance, normal = engine.distance_and_normal(points)
    exact = penalty_force(distance, normal)
    core = distance < -max(PROBE_DEPTHS.values())
    table = {}
    for field in fields:
        if field.ordered:
            continue
        force = penalty_force(*field.answer(points))
        size = np.linalg.norm(force, axis=1)
        off = np.linalg.norm(force - exact, axis=1)
        outside, inside = size[distance > 0], size[distance < 0]
        table[field.name] = {
            "ghost": float(outside.max(initial=0)),
            "ghosts": float((outside > 0).mean()) if len(outside) else 0.0,
            "missed": float((inside == 0).mean()) if len(inside) else 0.0,
            "core": float(off[core].mean() / -distance[core].mean()) if core.any() else None,
        }
    return table

"""How far a field's distances can be trusted to keep a probe out of contact.

A scene asks an object again only when the probe may touch it: a field at distance d cannot be
touched before the probe has gone d, less what the field errs. Measured against the exact distance.
"""

import numpy as np

from pandis.distance import ShapeDistance
from pandis.fields.base import BOUND, OK
from pandis.frame import Frame

#: Points in the box, and as many next to the surface outside.
POINTS = 60_000
#: Heights above the surface of the latter (unit frame), spread by logarithm.
HEIGHTS = 1e-4, 0.5
#: What is found at so many points may be more between them: by so much, and what rounding does.
MORE, ROUNDING = 1.5, 1e-9


def clearance(answer, mesh, engine, seed=0):
    """Measure where contacts of a field can be, and by how much its distance errs in free space.

    Parameters
    ----------
    answer : callable
        The field: distances (n,) and flags (n,) at points (n, 3), unit frame.
    mesh : pandis.artifact.Artifact
    engine : pandis.distance.MeshDistance or ShapeDistance
        Of that mesh.

    Returns
    -------
    ndarray, shape (8,)
        Lowest and highest corner of the surface's box, and two margins (unit frame). No contact
        lies further outside of the surface than the first, or nearer to a point than its distance
        less a margin: the first, or the second where the distance is flagged as a bound. All this
        holds at the points that were looked at, with half as much to spare.
    """
    rng = np.random.default_rng(seed)
    box = rng.uniform(-1, 1, (POINTS, 3))
    far, direction = engine.distance_and_normal(box, check=False)
    height = np.exp(rng.uniform(*np.log(HEIGHTS), POINTS))
    near = box + (height - far)[:, None] * direction
    near = near[(np.abs(near) <= 1).all(axis=1)]
    exact = np.concatenate([far, engine.distance_and_normal(near, check=False)[0]])
    found, flag = answer(np.concatenate([box, near]))
    free = (exact > 0) & np.isfinite(found)
    ghost = exact[free & (found < 0)].max(initial=0)
    over = [(found - exact)[free & (flag == kind)].max(initial=0) for kind in (OK, BOUND)]
    return np.array([*_box(mesh, engine), *(MORE * (ghost + most) + ROUNDING for most in over)])


def _box(mesh, engine):
    """Return the corners of the box around the surface, unit frame: six numbers."""
    frame = Frame.from_attributes(mesh.attributes["frame"])
    if isinstance(engine, ShapeDistance):
        # its tessellation lies inside of it
        half = engine.shape.half_extent
        return *frame.to_unit(-half), *frame.to_unit(half)
    points = mesh.arrays["vertices"]
    return *frame.to_unit(points.min(axis=0)), *frame.to_unit(points.max(axis=0))

"""Whether an exported field pushes back where the exact one does: on thin parts, too."""

from typing import NamedTuple

import numpy as np

from pandis.fields.controls import controls, demand_failure
from pandis.forces import force_of
from pandis.geometry.measure import (
    JUDGED,
    MISSING_LIMIT,
    Probes,
    Stratified,
    below,
    missing,
    shares,
    stratify,
)
from pandis.geometry.sampling import PROBE_DEPTHS
from pandis.run.records.hardware import WallVerdict
from pandis.streams import WALLS, generator

#: Surface points that forces are compared at; and that a simulated device presses on.
POINTS, PRESSED = 2000, 10


class Walls(NamedTuple):
    """Where the forces of a mesh's fields are compared with the exact ones.

    Attributes
    ----------
    places : pandis.geometry.measure.Stratified
        Of every class of inscribed radius as many; unit frame.
    probes : pandis.geometry.measure.Probes
        Below them, at the depth min(0.04, 0.9 r).
    pressed : pandis.geometry.measure.Stratified
        The few that a simulated device presses on.
    pressed_probes : pandis.geometry.measure.Probes
        Below those.
    scale : pandis.geometry.physical.Scale
    """

    places: Stratified
    probes: Probes
    pressed: Stratified
    pressed_probes: Probes
    scale: object


def open_walls(exact, surface, scale, seed):
    """Draw the points of a mesh, and see that no control passes on them.

    Parameters
    ----------
    exact : pandis.fields.exact.ExactField
    surface : pandis.geometry.sampling.Surface
    scale : pandis.geometry.physical.Scale
    seed : int

    Returns
    -------
    Walls

    Raises
    ------
    PandisError
        A control passes.
    """
    rng, engine = generator(seed, WALLS), exact.engine
    drawn = []
    for count in (POINTS, PRESSED):
        places = stratify(surface, engine, scale, count, rng)
        depth = places.depth(PROBE_DEPTHS["deep"])
        drawn += [places, below(engine, places.feet, places.outward, depth)]
    walls = Walls(*drawn, scale)
    tried = {c.name: compare(force_of(c), walls)
             for c in controls(exact, surface, scale)}  # fmt: skip
    demand_failure("the hardware verdict", (n for n, compared in tried.items() if compared.holds))
    return walls


def compare(force_at, walls):
    """Compare a field's forces with the exact ones.

    Parameters
    ----------
    force_at : callable
        Answers the force (n, 3) at points (n, 3), unit frame, k = 1.
    walls : Walls

    Returns
    -------
    WallVerdict
    """
    newtons = walls.scale.newtons
    force = force_at(walls.probes.points)
    figures = shares(force, walls.probes.force, newtons, walls.places.weight)
    exact = walls.pressed_probes.force
    judged = np.linalg.norm(exact, axis=1) * newtons >= JUDGED
    gone = judged & missing(force_at(walls.pressed_probes.points), exact, newtons)
    return WallVerdict(
        **figures,
        points=len(walls.places.feet),
        pressed_missing=int(gone.sum()),
        holds=bool(figures["missing"] <= MISSING_LIMIT and not gone.any()),
    )

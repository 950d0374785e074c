"""Compares the forces of an exported field with the exact ones, including on thin parts."""

from typing import NamedTuple

from pandis.base.forces import force_of
from pandis.base.streams import WALLS, generator
from pandis.pipeline.geometry.measure import ContactSet, below, draw_contacts
from pandis.pipeline.geometry.places import Stratified, stratify
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS
from pandis.pipeline.geometry.shares import (
    JUDGED,
    MISSING_LIMIT,
    PATCH_LIMIT,
    STRONG_LIMIT,
    Probes,
    differences,
    missing,
    shares,
)
from pandis.pipeline.judge.controls import controls, demand_failure
from pandis.pipeline.judge.stress.ghosts import far_ghosts
from pandis.pipeline.run.records.hardware import WallVerdict

#: Forces are compared at POINTS surface points. A simulated device presses on about PRESSED points.
POINTS, PRESSED = 20_000, 10
#: Largest allowed 99th percentile of ‖F − F_exact‖ (N). At the default stiffness, it is about half
#: of the mean exact force at a probe's greatest depth.
TAIL_LIMIT = 0.2


class Walls(NamedTuple):
    """Points at which the forces of a mesh's fields are compared with the exact ones.

    Attributes
    ----------
    contacts : pandis.pipeline.geometry.measure.ContactSet
    pressed : pandis.pipeline.geometry.places.Stratified
        Points on which a simulated device presses, the same number per class of inscribed radius.
    pressed_probes : pandis.pipeline.geometry.shares.Probes
        Probes below ``pressed``, at the depth min(0.04, 0.9 r), unit frame.
    thin : pandis.pipeline.geometry.places.Stratified
        Likewise, for presses through a proxy. These points may also be on walls that are too thin
        for a penalty force to resist a hand.
    """

    contacts: ContactSet
    pressed: Stratified
    pressed_probes: Probes
    thin: Stratified


def open_walls(exact, scale, seed):
    """Draw the points at which forces are compared, and check that every control fails there.

    Parameters
    ----------
    exact : pandis.pipeline.kinds.field.ExactField
    scale : pandis.base.physical.Scale
    seed : int

    Returns
    -------
    Walls

    Raises
    ------
    PandisError
        A control passes.
    """
    rng, body = generator(seed, WALLS), exact.body
    contacts = draw_contacts(body, scale, POINTS, rng=rng)
    pressed, thin = (stratify(body, scale, PRESSED, rng=rng, among=among)
                     for among in ("pushing", "all"))  # fmt: skip
    depth = pressed.depth(PROBE_DEPTHS["deep"])
    probes = below(
        exact.engine, pressed.feet, pressed.outward, depth=depth, wall=pressed.wall, scale=scale
    )
    walls = Walls(contacts, pressed, probes, thin)
    tried = {c.name: compare(c, walls)
             for c in controls(exact, scale)}  # fmt: skip
    demand_failure("the hardware verdict", (n for n, compared in tried.items() if compared.holds))
    return walls


def compare(field, walls):
    """Compare a field's forces with the exact ones.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    walls : Walls

    Returns
    -------
    WallVerdict
    """
    force_at = force_of(field)
    full, deep = walls.contacts.pressed, walls.contacts.sets["contact-deep"]
    figures = shares(force_at(full.points), full) | differences(force_at(deep.points), deep)
    probes = walls.pressed_probes
    scale = probes.scale
    ghost_n = far_ghosts(field.answer, probes.engine, scale)
    force = force_at(probes.points)
    gone = probes.judged & missing(force, probes.force, probes.wall, newtons=scale.newtons)
    verdict = WallVerdict(
        **figures, left_out=walls.contacts.left_out, points=len(full.points),
        pressed_missing=int(gone.sum()), ghost_n=ghost_n, holds=False,
    )  # fmt: skip
    return verdict.model_copy(update={"holds": not gone.any() and not faults(verdict)})


def faults(verdict):
    """Return the faults of a field's forces as clauses of a sentence; an empty list if none.

    Parameters
    ----------
    verdict : pandis.pipeline.run.records.hardware.WallVerdict
    """
    clauses = []
    if verdict.left_out >= 1:
        return ["all of the surface is too thin to be judged"]
    if verdict.missing > MISSING_LIMIT:
        clauses.append(f"on {verdict.missing:.2%} of the surface the force is missing")
    if verdict.left_out > MISSING_LIMIT:
        clauses.append(f"{verdict.left_out:.2%} of the surface is too thin to be judged")
    if verdict.strongly_felt > STRONG_LIMIT or verdict.patch > PATCH_LIMIT:
        clauses.append(
            f"on {verdict.strongly_felt:.2%} of the surface the force feels strongly "
            f"different, on {verdict.patch:.2%} in one patch"
        )
    if verdict.p99_n > TAIL_LIMIT:
        clauses.append(f"one force in a hundred is off by {verdict.p99_n:.2g} N or more")
    if not verdict.ghost_n < JUDGED:
        clauses.append(f"in free space there are forces of up to {verdict.ghost_n:.2g} N")
    return clauses

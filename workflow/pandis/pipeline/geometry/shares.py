"""On which share of a surface a force is missing, or feels different from the exact one.

Places are of three kinds. A *wall* (`pandis.pipeline.geometry.thickness.are_walls`) is judged
however little
it can push, for a proxy holds any force on it. Elsewhere the matter is thick, and what makes the
largest ball inside small is a convex edge, which every smooth field rounds: such a place is judged
from 0.05 N on. Walls thinner than 0.02 mm are left out, and their share stands beside every
verdict.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pandis.base.arrays import Flags, Points
from pandis.base.forces import penalty_force
from pandis.base.physical import Scale

#: Walls thinner than this are left out (m, in the device's workspace).
THINNEST = 2e-5
#: Away from walls, places where the exact force is less than this (N) are not judged: a hand would
#: not feel it.
JUDGED = 0.05
#: At a wall a force may fall short by this (N), whatever the exact one is: rounding.
ROUNDING = 5e-6
#: A force is missing if it pushes back with less than this share of the exact one.
MISSING = 0.5
#: A difference is felt beyond this share of the exact force, or these newtons if that is more, or
#: if the direction is off by more than this (degrees); strongly felt beyond the other share.
FELT_SHARE, STRONG_SHARE, FELT_NEWTONS, FELT_ANGLE = 0.1, 0.4, 0.02, 25.0
#: A field may lack so much of the surface, wherever fields are judged, and so much of it may be too
#: thin to be judged: shares of the area.
MISSING_LIMIT = 0.005
#: So much of the surface may feel strongly different, and so much of it in one patch: above what
#: the fields of the default configuration have on scans and on parts with sharp edges, and below a
#: patch that a fingertip finds.
STRONG_LIMIT, PATCH_LIMIT = 0.015, 0.0025
#: A smooth field may mix the exact force at a point with that at this distance (m) beside it; the
#: second number is how many places around the point are compared.
BESIDE, _AROUND = 1e-3, 8
#: Neighbours that a patch is told by: most of them are strongly felt, too. Two sides of a wall are
#: as far apart as this (unit frame) besides.
_NEIGHBOURS, _SIDES = 8, 0.1


@dataclass(frozen=True)
class Probes:
    """Points below a surface with their exact answers: what forces are held against.

    Attributes
    ----------
    points : ndarray, shape (n, 3), unit frame
    distance : ndarray, shape (n,)
    normal : ndarray, shape (n, 3)
    wall : ndarray, shape (n,)
        Which of them lie below a wall.
    scale : pandis.base.physical.Scale
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    """

    points: np.ndarray
    distance: np.ndarray
    normal: np.ndarray
    wall: np.ndarray
    scale: Scale
    engine: object

    @cached_property
    def force(self):
        """The exact force (n, 3) at k = 1."""
        return penalty_force(self.distance, self.normal)

    @cached_property
    def newtons(self):
        """Its size (n,) in newtons."""
        return np.linalg.norm(self.force, axis=1) * self.scale.newtons

    @property
    def judged(self):
        """Which points (n,) are judged: below walls, and where 0.05 N or more push."""
        return self.wall | (self.newtons >= JUDGED)

    @cached_property
    def around(self):
        """The exact forces (n, m, 3) a millimetre beside each point, across its normal."""
        side = np.linalg.svd(self.normal[:, None])[2][:, 1:]
        turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
        ring = np.einsum("mk,nkj->nmj", np.stack([np.cos(turn), np.sin(turn)], 1), side)
        beside = self.points[:, None] + BESIDE * self.scale.metre * ring
        answers = self.engine.distance_and_normal(beside.reshape(-1, 3), check=False)
        return penalty_force(*answers).reshape(beside.shape)


def missing(force: Points, exact: Points, wall: Flags, newtons) -> Flags:
    """Tell where a force is missing (n,): less than half of the exact one.

    Away from walls it has to fall short by 0.05 N besides.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3), unit frame, k = 1
    wall : ndarray, shape (n,)
    newtons : float
        Newtons per force of the unit frame.
    """
    size = np.linalg.norm(exact, axis=1)
    against = np.einsum("ij,ij->i", force, exact) / np.maximum(size, 1e-300)
    floor = np.where(wall, ROUNDING, JUDGED) / newtons
    # NaN is no force either
    return ~(against >= MISSING * size) & ~(against > size - floor)


def felt(force: Points, exact: Points, newtons, share=FELT_SHARE) -> Flags:
    """Tell where a difference of forces can be felt (n,).

    Parameters
    ----------
    force, exact, newtons
        As for `missing`.
    share : float
        Share of the exact force, by which the other one may differ.
    """
    size = np.linalg.norm(exact, axis=1)
    off = np.linalg.norm(force - exact, axis=1)
    length = np.linalg.norm(force, axis=1)
    along = np.einsum("ij,ij->i", force, exact)
    turned = ~(along >= np.cos(np.radians(FELT_ANGLE)) * length * size)
    # the direction of next to nothing is no difference
    turned &= ~((length < FELT_NEWTONS / newtons) & (size < FELT_NEWTONS / newtons))
    return ~(off <= np.maximum(share * size, FELT_NEWTONS / newtons)) | turned


def strongly_felt(force: Points, probes) -> Flags:
    """Tell where a force is strongly felt to be another one (n,), away from convex edges.

    Next to an edge a smooth field turns from the force of one side to that of the other: what lies
    between the exact force at a point and one a millimetre beside it is no fault.

    Parameters
    ----------
    force : ndarray, shape (n, 3), unit frame, k = 1
    probes : Probes
    """
    newtons = probes.scale.newtons
    strong = felt(force, probes.force, newtons, STRONG_SHARE)
    left = np.flatnonzero(strong)
    for there in np.moveaxis(probes.around, 1, 0) if len(left) else ():
        here = probes.force[left]
        way = there[left] - here
        along = np.einsum("ij,ij->i", force[left] - here, way)
        square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-300)
        mixed = here + np.clip(along / square, 0, 1)[:, None] * way
        # on the way it may keep its size: the chord of two directions is shorter than their arc
        least = np.linalg.norm(mixed, axis=1)
        most = np.maximum(np.linalg.norm(here, axis=1), np.linalg.norm(there[left], axis=1))
        size = np.clip(np.linalg.norm(force[left], axis=1), least, most)
        mixed *= (size / np.maximum(least, 1e-300))[:, None]
        left = left[felt(force[left], mixed, newtons, STRONG_SHARE)]
    strong[:] = False
    strong[left] = True
    return strong


def largest_patch(probes, flags: Flags):
    """Return the share of the points in the largest patch of those that are flagged.

    A point belongs to one if most of its neighbours are flagged, too: a line is no patch, nor are
    single points.
    """
    if flags.sum() <= _NEIGHBOURS:
        return 0.0
    places = np.concatenate([probes.points, _SIDES / 2 * probes.normal], axis=1)
    distance, near = cKDTree(places).query(places, _NEIGHBOURS + 1)
    core = np.flatnonzero(flags & (flags[near[:, 1:]].mean(axis=1) > 0.5))
    if not len(core):
        return 0.0
    reach = float(np.median(distance[core, -1]))
    one, other = cKDTree(places[core]).query_pairs(reach, output_type="ndarray").T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(len(core), len(core)))
    return float(np.bincount(connected_components(graph, directed=False)[1]).max() / len(flags))


def shares(force: Points, probes):
    """Count by share of area where a force is missing, and where it feels different.

    Parameters
    ----------
    force : ndarray, shape (n, 3), unit frame, k = 1
    probes : Probes
        Each stands for the same area.

    Returns
    -------
    dict of str to float
        ``missing``, of the area judged, and ``judged``, that area's share; ``felt``: of the area
        where the exact force is at least 0.05 N. Where nothing is judged, all of it counts as
        missing, so that no verdict rests on nothing.
    """
    judged, pushing = probes.judged, probes.newtons >= JUDGED
    gone = missing(force, probes.force, probes.wall, probes.scale.newtons)[judged]
    different = felt(force, probes.force, probes.scale.newtons)[pushing]
    return {
        "judged": float(judged.mean()) if len(judged) else 0.0,
        "missing": float(gone.mean()) if len(gone) else 1.0,
        "felt": float(different.mean()) if len(different) else 1.0,
    }


def differences(force: Points, probes):
    """Measure how far a force is from the exact one.

    Parameters
    ----------
    force, probes
        As for `shares`.

    Returns
    -------
    dict of str to float
        ``strongly_felt``: on which share of the area; ``patch``: in one patch of it; ``p99_n``:
        the 99th percentile of ‖F − F_exact‖, newtons. Where there is no point, all of the area.
    """
    if not len(force):
        return {"strongly_felt": 1.0, "patch": 1.0, "p99_n": 0.0}
    strong = strongly_felt(force, probes)
    error = np.linalg.norm(force - probes.force, axis=1) * probes.scale.newtons
    return {
        "strongly_felt": float(strong.mean()),
        "patch": largest_patch(probes, strong),
        "p99_n": float(np.percentile(np.where(np.isnan(error), np.inf, error), 99)),
    }

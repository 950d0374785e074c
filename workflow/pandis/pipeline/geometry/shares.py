"""Shares of a surface on which a force is missing, or feels different from the exact one.

There are three kinds of places. A *wall* (`pandis.pipeline.geometry.thickness.are_walls`) is judged
even where its force is small, because a proxy can press on it with any force. Elsewhere the solid
is thick, and inscribed balls are small only at convex edges. Every smooth field rounds these, so
such places are judged only if the force is at least 0.05 N. Walls thinner than 0.02 mm are left
out, and every verdict reports their share.
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
#: Away from walls, places where the exact force is less than this (N) are not judged, because a
#: hand does not feel it.
JUDGED = 0.05
#: Allowance (N) for rounding: at a wall, any force may fall short of the exact one by this much.
ROUNDING = 5e-6
#: A force is missing if its component along the exact force is below this share of that force.
MISSING = 0.5
#: A difference is felt if it exceeds both FELT_SHARE of the exact force and FELT_NEWTONS, or if the
#: direction is off by more than FELT_ANGLE (degrees). It is strongly felt if this holds with
#: STRONG_SHARE instead of FELT_SHARE.
FELT_SHARE, STRONG_SHARE, FELT_NEWTONS, FELT_ANGLE = 0.1, 0.4, 0.02, 25.0
#: Largest share of the area on which a field's force may be missing. It also limits the share that
#: may be too thin to be judged.
MISSING_LIMIT = 0.005
#: Largest shares of the surface that may feel strongly different, in total and in one patch. Fields
#: of the default configuration stay below both on scans and on parts with sharp edges. A fingertip
#: notices only patches larger than PATCH_LIMIT.
STRONG_LIMIT, PATCH_LIMIT = 0.015, 0.0025
#: A smooth field may blend the exact force at a point with the exact force this far (m) beside it.
#: _AROUND is the number of directions that are tried around the point.
BESIDE, _AROUND = 1e-3, 8
#: A flagged point is in a patch if most of its _NEIGHBOURS nearest points are flagged, too. _SIDES
#: (unit frame) is added to the distance between the two sides of a wall, to separate them.
_NEIGHBOURS, _SIDES = 8, 0.1


@dataclass(frozen=True)
class Probes:
    """Points below a surface, and the exact data against which forces are compared.

    Attributes
    ----------
    points : ndarray, shape (n, 3), unit frame
    distance : ndarray, shape (n,)
    normal : ndarray, shape (n, 3)
    wall : ndarray, shape (n,)
        Whether each point is below a wall.
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
        """The exact force's magnitude (n,) in newtons."""
        return np.linalg.norm(self.force, axis=1) * self.scale.newtons

    @property
    def judged(self):
        """Mask (n,) of the judged points: those below walls or with a force of 0.05 N or more."""
        return self.wall | (self.newtons >= JUDGED)

    @cached_property
    def around(self):
        """The exact forces (n, m, 3) at k = 1, a millimetre beside each point in m directions."""
        side = np.linalg.svd(self.normal[:, None])[2][:, 1:]
        turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
        ring = np.einsum("mk,nkj->nmj", np.stack([np.cos(turn), np.sin(turn)], 1), side)
        beside = self.points[:, None] + BESIDE * self.scale.metre * ring
        answers = self.engine.distance_and_normal(beside.reshape(-1, 3), check=False)
        return penalty_force(*answers).reshape(beside.shape)


def missing(force: Points, exact: Points, wall: Flags, *, newtons) -> Flags:
    """Return a mask (n,) of the points where a force is missing: less than half of the exact one.

    Away from walls, it must also fall short by at least 0.05 N.

    Parameters
    ----------
    force, exact : ndarray, shape (n, 3), unit frame, k = 1
    wall : ndarray, shape (n,)
    newtons : float
        Newtons per unit of force in the unit frame.
    """
    size = np.linalg.norm(exact, axis=1)
    against = np.einsum("ij,ij->i", force, exact) / np.maximum(size, 1e-300)
    floor = np.where(wall, ROUNDING, JUDGED) / newtons
    # NaN counts as missing
    return ~(against >= MISSING * size) & ~(against > size - floor)


def felt(force: Points, exact: Points, newtons, *, share=FELT_SHARE) -> Flags:
    """Return a mask (n,) of the points where the difference between two forces can be felt.

    Parameters
    ----------
    force, exact, newtons
        As for `missing`.
    share : float
        Largest difference that is not felt, as a share of the exact force.
    """
    size = np.linalg.norm(exact, axis=1)
    off = np.linalg.norm(force - exact, axis=1)
    length = np.linalg.norm(force, axis=1)
    along = np.einsum("ij,ij->i", force, exact)
    turned = ~(along >= np.cos(np.radians(FELT_ANGLE)) * length * size)
    # the direction of a negligible force cannot be felt
    turned &= ~((length < FELT_NEWTONS / newtons) & (size < FELT_NEWTONS / newtons))
    return ~(off <= np.maximum(share * size, FELT_NEWTONS / newtons)) | turned


def strongly_felt(force: Points, probes) -> Flags:
    """Return a mask (n,) of points where a force feels strongly different, blending at edges aside.

    Next to an edge, the force of a smooth field turns gradually from one side's to the other's.
    Any force between the exact one at a point and the exact one a millimetre beside it is therefore
    accepted.

    Parameters
    ----------
    force : ndarray, shape (n, 3), unit frame, k = 1
    probes : Probes
    """
    newtons = probes.scale.newtons
    strong = felt(force, probes.force, newtons, share=STRONG_SHARE)
    left = np.flatnonzero(strong)
    for there in np.moveaxis(probes.around, 1, 0) if len(left) else ():
        here = probes.force[left]
        way = there[left] - here
        along = np.einsum("ij,ij->i", force[left] - here, way)
        square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-300)
        mixed = here + np.clip(along / square, 0, 1)[:, None] * way
        # a blend on the chord between two directions is too short: also allow full magnitude
        least = np.linalg.norm(mixed, axis=1)
        most = np.maximum(np.linalg.norm(here, axis=1), np.linalg.norm(there[left], axis=1))
        size = np.clip(np.linalg.norm(force[left], axis=1), least, most)
        mixed *= (size / np.maximum(least, 1e-300))[:, None]
        left = left[felt(force[left], mixed, newtons, share=STRONG_SHARE)]
    strong[:] = False
    strong[left] = True
    return strong


def largest_patch(probes, flags: Flags):
    """Return the share of all points that are in the largest patch of flagged points.

    A flagged point is in a patch if most of its neighbours are flagged, too. Lines and single
    points are therefore not patches.
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
    """Return the shares of area where a force is missing, and where it feels different.

    Parameters
    ----------
    force : ndarray, shape (n, 3), unit frame, k = 1
    probes : Probes
        Points that each represent the same area.

    Returns
    -------
    dict of str to float
        ``missing`` is relative to the judged area, ``judged`` to all area, and ``felt`` to the
        area where the exact force is at least 0.05 N. If no area is judged, ``missing`` is 1, so
        that no field passes without evidence.
    """
    judged, pushing = probes.judged, probes.newtons >= JUDGED
    gone = missing(force, probes.force, probes.wall, newtons=probes.scale.newtons)[judged]
    different = felt(force, probes.force, probes.scale.newtons)[pushing]
    return {
        "judged": float(judged.mean()) if len(judged) else 0.0,
        "missing": float(gone.mean()) if len(gone) else 1.0,
        "felt": float(different.mean()) if len(different) else 1.0,
    }


def differences(force: Points, probes):
    """Measure how strongly a force differs from the exact one.

    Parameters
    ----------
    force, probes
        As for `shares`.

    Returns
    -------
    dict of str to float
        ``strongly_felt``: share of the area; ``patch``: share in the largest patch; ``p99_n``: the
        99th percentile of ‖F − F_exact‖, newtons. Without points, both shares are 1.
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

"""Control fields: the verdicts of a judgement count only if it fails every control.

They are never exported, chosen or configured. A judgement that passes a control cannot detect
missing force, and its stage ends with an error.
"""

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.bvh import Bvh
from pandis.pipeline.geometry.distance import SURFACE_DISTANCE, MeshDistance
from pandis.pipeline.geometry.measure import OF_RADIUS, too_thin
from pandis.pipeline.geometry.places import THICKEST
from pandis.pipeline.geometry.shares import JUDGED
from pandis.pipeline.geometry.thickness import are_walls, inscribed_radius
from pandis.pipeline.kinds.field import Field

#: GAP is the share of the area on which a control has no force: of the judged area for
#: `control-gap`, of all area for `control-thin`. It is four times `MISSING_LIMIT`. There is a
#: `control-thin` only if walls cover at least the share LEAST_WALLS of the area.
GAP, LEAST_WALLS = 0.02, 0.01
#: Number of surface points sampled to find the largest radius in the gap.
_POOL = 20_000
#: Radii that differ by less than this count as equal. Equal ones are ordered by face index, then by
#: barycentrics.
_SAME_RADIUS = 1e-5


class ControlZero(Field):
    """A field without force: every point is out of contact."""

    def __init__(self, exact):
        super().__init__("control-zero", exact.frame, 0)

    def answer(self, points):
        """Return distance 1 and an upward normal at points (n, 3); NaN if they are not finite."""
        distance = np.where(np.isfinite(points).all(axis=1), 1.0, np.nan)
        normal = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        return distance, np.where(np.isnan(distance)[:, None], np.nan, normal)


class ControlGap(Field):
    """The exact field with a gap: no force where the object is thinnest.

    The gap consists of the places with the smallest inscribed radius at the closest surface point,
    among those that a filter accepts. Equal radii are ordered by face and by position in the face,
    so that even a ball or a plate has a gap.

    Parameters
    ----------
    name : str
    exact : pandis.pipeline.kinds.field.ExactField
    passes : callable
        The filter: takes radii (n,) and a mask of walls (n,); returns a mask of accepted places.
    of_all : bool
        Whether `GAP` is a share of all area instead of the accepted places only.

    Attributes
    ----------
    counts : float
        Share of the area that the filter accepts.
    """

    def __init__(self, name, exact, passes, *, of_all=False):
        super().__init__(name, exact.frame, exact.bytes)
        self.engine, self.exact, self._passes = exact.engine, exact, passes
        surface = exact.body.surface
        # a closed form has no faces: use those of its tessellation
        mesh = isinstance(self.engine, MeshDistance)
        self._faces = None if mesh else Bvh(surface.corners.reshape(-1, 3), _every(surface))
        feet, outward, _, _ = surface.draw(_POOL, np.random.default_rng(0))
        radius = inscribed_radius(self.engine, feet, outward, largest=THICKEST)
        counts = self._count(radius, feet, outward)
        keys = self._keys(radius, feet - SURFACE_DISTANCE * 10 * outward, feet)[counts]
        keys = keys[np.lexsort(keys.T[::-1])]
        self.counts = float(counts.mean())
        last = int(GAP * (_POOL if of_all else len(keys)))
        self._last = tuple(keys[min(last, len(keys) - 1)]) if len(keys) else None

    def answer(self, points):
        """Return distance (n,), 0 in the gap, and normal (n, 3) at points (n, 3), unit frame."""
        distance, normal = self.exact.answer(points)
        inside = np.flatnonzero(distance < 0)
        if self._last is None or not len(inside):
            return distance, normal
        feet = points[inside] - distance[inside, None] * normal[inside]
        # cap the search: a place with a larger radius than the gap's last place is outside the gap
        most = min((self._last[0] + 1) * _SAME_RADIUS, THICKEST)
        radius = inscribed_radius(self.engine, feet, normal[inside], largest=most)
        small = (radius < most) | (most == THICKEST)
        inside, feet, radius = inside[small], feet[small], radius[small]
        before = _before(self._keys(radius, points[inside], feet), self._last)
        gap = before & self._count(radius, feet, normal[inside])
        distance = distance.copy()
        distance[inside[gap]] = 0.0
        return distance, normal

    def _count(self, radius, feet, outward):
        """Return the mask (n,) of surface points that the filter accepts."""
        return self._passes(radius, are_walls(self.engine, feet, outward, radius=radius))

    def _keys(self, radius, points, feet):
        """Return sort keys (n, 4) of surface points: radius, face, last two barycentrics."""
        if self._faces is None:
            labels = self.engine.label(points, ties=False, check=False)
        else:
            labels = self._faces.label(feet, SURFACE_DISTANCE, check=False)
        step = np.rint(radius / _SAME_RADIUS)
        return np.column_stack([step, labels.face, labels.barycentrics[:, 1:]])


def controls(exact, scale):
    """Return the fields that every judgement of a mesh must fail.

    ``control-zero`` has no force. ``control-gap`` has none on the thinnest 2 % of the area
    judged. ``control-thin`` has none on the thinnest walls, up to 2 % of all area: it exposes
    judgements that ignore thin places. It is omitted for objects whose walls cover less than 1 %
    of the area.

    Parameters
    ----------
    exact : pandis.pipeline.kinds.field.ExactField
    scale : pandis.base.physical.Scale
    """

    def is_wall(radius, wall):
        return wall & ~too_thin(radius, wall, scale)

    def is_judged(radius, wall):
        return is_wall(radius, wall) | (OF_RADIUS * radius * scale.newtons >= JUDGED)

    gap = ControlGap("control-gap", exact, is_judged)
    thin = ControlGap("control-thin", exact, is_wall, of_all=True)
    return [ControlZero(exact), gap, *([thin] if thin.counts >= LEAST_WALLS else [])]


def demand_failure(judgement, passed):
    """Raise an error if a judgement passes a control.

    Parameters
    ----------
    judgement : str
        Name of the judgement, as the subject of a sentence.
    passed : iterable of str
        Names of the controls that passed.

    Raises
    ------
    PandisError
        A control has passed.
    """
    passed = list(passed)
    if passed:
        raise PandisError(
            f"{judgement} is blind on this mesh: it passes {' and '.join(passed)}, though force "
            "is missing on a part of the surface, so its verdicts on other fields mean nothing. "
            "This is a defect of pandis: please report it with the mesh"
        )


def _every(surface):
    """Return faces (F, 3) that index the corners of a surface in order."""
    return np.arange(3 * len(surface.faces), dtype=np.int32).reshape(-1, 3)


def _before(keys, last):
    """Return the mask (n,) of keys (n, 4) that sort before ``last``, first column first."""
    before, equal = np.zeros(len(keys), bool), np.ones(len(keys), bool)
    for column, value in zip(keys.T, last, strict=True):
        before |= equal & (column < value)
        equal &= column == value
    return before

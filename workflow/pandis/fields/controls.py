"""Fields that every judgement must fail: what a verdict is tried on before it is believed.

Neither is ever exported, chosen or configured. A judgement that passes one of them is blind, and
ends its stage.
"""

import numpy as np

from pandis.errors import PandisError
from pandis.fields.base import Field
from pandis.geometry.distance import SURFACE_DISTANCE, MeshDistance
from pandis.geometry.measure import JUDGED, OF_RADIUS, THICKEST
from pandis.geometry.thickness import inscribed_radius
from pandis.native.bvh import Bvh

#: Share of the judged area on which `control-gap` has no force: four times what may be missing.
GAP = 0.02
#: Surface points that the radius is taken from below which the gap lies.
_POOL = 20_000
#: Radii that differ by less are the same: then the number of the face decides, then the place.
_SAME_RADIUS = 1e-5


class ControlZero(Field):
    """No force anywhere: every place is out of contact."""

    def __init__(self, exact):
        super().__init__("control-zero", exact.frame, 0)

    def answer(self, points):
        """Answer a distance of 1 and an upward normal at points (n, 3); NaN where they are."""
        distance = np.where(np.isfinite(points).all(axis=1), 1.0, np.nan)
        normal = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        return distance, np.where(np.isnan(distance)[:, None], np.nan, normal)


class ControlGap(Field):
    """The exact field, without force at the thinnest two hundredths of the surface.

    Of the area that is judged (see `pandis.geometry.measure`), those with the smallest inscribed
    radius at the closest point of the surface; among equal radii the first by face and place in it,
    so that a ball or a plate has a gap, too.

    Parameters
    ----------
    exact : pandis.fields.exact.ExactField
    surface : pandis.geometry.sampling.Surface
    scale : pandis.geometry.physical.Scale
    """

    def __init__(self, exact, surface, scale):
        super().__init__("control-gap", exact.frame, exact.bytes)
        self.engine, self.exact = exact.engine, exact
        # a closed form has no faces: its tessellation's are asked
        mesh = isinstance(self.engine, MeshDistance)
        self._faces = None if mesh else Bvh(surface.corners.reshape(-1, 3), _every(surface))
        self._least = JUDGED / scale.newtons / OF_RADIUS
        feet, outward, _, _ = surface.draw(_POOL, np.random.default_rng(0))
        keys = self._keys(feet - SURFACE_DISTANCE * 10 * outward, feet, outward)
        judged = keys[keys[:, 0] * _SAME_RADIUS >= self._least]
        judged = judged[np.lexsort(judged.T[::-1])]
        self._last = tuple(judged[int(GAP * len(judged))]) if len(judged) else None

    def answer(self, points):
        """Answer distance (n,), 0 in the gap, and normal (n, 3) at points (n, 3), unit frame."""
        distance, normal = self.exact.answer(points)
        inside = np.flatnonzero(distance < 0)
        if self._last is not None and len(inside):
            feet = points[inside] - distance[inside, None] * normal[inside]
            keys = self._keys(points[inside], feet, normal[inside])
            gap = (keys[:, 0] * _SAME_RADIUS >= self._least) & _before(keys, self._last)
            distance = distance.copy()
            distance[inside[gap]] = 0.0
        return distance, normal

    def _keys(self, points, feet, outward):
        """Return what orders surface points (n, 4): radius, face, second and third weight."""
        if self._faces is None:
            labels = self.engine.label(points, ties=False, check=False)
        else:
            labels = self._faces.label(feet, SURFACE_DISTANCE, check=False)
        radius = np.rint(inscribed_radius(self.engine, feet, outward, THICKEST) / _SAME_RADIUS)
        return np.column_stack([radius, labels.face, labels.barycentrics[:, 1:]])


def controls(exact, surface, scale):
    """Return the fields that every judgement of a mesh must fail."""
    return [ControlZero(exact), ControlGap(exact, surface, scale)]


def demand_failure(judgement, passed):
    """End a stage whose judgement is blind.

    Parameters
    ----------
    judgement : str
        What judged, as the subject of a sentence.
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
            f"{judgement} is blind on this mesh: it passes {' and '.join(passed)}, a field that "
            "lacks the force on a part of the surface, so that it says nothing about other "
            "fields either; this is a defect of pandis: please report it with the mesh"
        )


def _every(surface):
    """Return faces (F, 3) over the corners of a surface, one after the other."""
    return np.arange(3 * len(surface.faces), dtype=np.int32).reshape(-1, 3)


def _before(keys, last):
    """Tell which keys (n, 4) come before another, by their first column, then the next."""
    before, equal = np.zeros(len(keys), bool), np.ones(len(keys), bool)
    for column, value in zip(keys.T, last, strict=True):
        before |= equal & (column < value)
        equal &= column == value
    return before

"""The interface of every field."""

import copy
from typing import NamedTuple

import numpy as np

from pandis.base.arrays import Points, Values
from pandis.base.frame import Frame

#: Flags of an answer. OK: within the field's accuracy. BOUND: outside the region that the field
#: covers; the distance is an estimate with the right sign. INVALID: the point is not finite, so
#: there is no answer. CUT: not all faces were visited; the distance may be a little too large.
OK, BOUND, INVALID, CUT = 0, 1, 2, 3


class Answer(NamedTuple):
    """A field's answer at points (n, 3).

    Attributes
    ----------
    distance : ndarray, shape (n,)
    normal : ndarray, shape (n, 3)
    flag : ndarray, shape (n,), uint8
        OK, BOUND, INVALID or CUT.
    """

    distance: np.ndarray
    normal: np.ndarray
    flag: np.ndarray


class Field:
    """An approximation of a mesh's signed distance and unit normal.

    Subclasses implement ``answer(points)`` in the unit frame.

    Attributes
    ----------
    name : str
        As in the configuration.
    kind : str
        A key of `pandis.pipeline.run.ask.kinds.KINDS`.
    frame : pandis.base.frame.Frame
    bytes : int
        Memory that a program needs to query the field.
    ordered : bool
        Answers depend on the path: the points of a call form a path that begins out of contact.
    keeps_length : bool
        The length of the direction is meaningful, because it was trained to be 1. Such a field
        has ``direction(points)``, which returns distance (n,) and direction (n, 3), not
        normalised. The paper's force is multiplied by that length.
    """

    kind = ""
    ordered = keeps_length = False

    def __init__(self, name, frame, size):
        self.name, self.frame, self.bytes = name, frame, size

    def distance_and_normal(self, points: Points):
        """Return distances and normals in mesh units.

        Parameters
        ----------
        points : ndarray, shape (n, 3), mesh units

        Returns
        -------
        distance : ndarray, shape (n,), mesh units, negative inside
        normal : ndarray, shape (n, 3), unit length, outward
        """
        distance, normal = self.answer(self.frame.to_unit(points))
        return distance / self.frame.scale, normal

    def query(self, points):
        """Return the answer with flags (unit frame); by default a field covers only its box.

        Returns
        -------
        Answer
        """
        distance, normal = self.answer(points)
        outside = (np.abs(points) > 1).any(axis=1)
        flag = np.where(outside, BOUND, OK).astype(np.uint8)
        flag[np.isnan(distance)] = INVALID
        return Answer(distance, normal, flag)

    def placed(self, factor, offset):
        """Return the field as if its mesh had other units and another position.

        Parameters
        ----------
        factor : float
            Factor on lengths, applied after the mesh is moved by ``offset`` (3,), mesh units.
        """
        moved, old = copy.copy(self), self.frame
        moved.frame = Frame(tuple(factor * (np.array(old.centre) + offset)), old.scale / factor)
        return moved

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame.

        Both are NaN where a point is not finite.
        """
        raise TypeError(f"{type(self).__name__} must implement answer()")


class ExactField(Field):
    """Exact distance and direction of a body: the reference for all other fields."""

    kind = "exact"

    def __init__(self, name, body):
        self.body, self.engine = body, body.distance
        super().__init__(name, body.frame, body.bytes)

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        # unchecked, as in a device loop: the winding number checks signs when labels are made
        return self.engine.distance_and_normal(points, check=False)


def clamp_to_box(points: Points, low=-1.0, high=1.0) -> tuple[Points, Values]:
    """Clamp points to a box: [-1, 1]³, or the box between two corners.

    Returns
    -------
    clamped : ndarray, shape (n, 3)
    outside : ndarray, shape (n,)
        How far each point was moved. Added to the distance at the clamped
        point, it gives an upper bound that stays positive, so that no field
        has a ghost contact far from its box.
    """
    clamped = np.clip(points, low, high)
    with np.errstate(over="ignore"):  # beyond 1e154 the norm overflows to infinity
        return clamped, np.linalg.norm(points - clamped, axis=1)


def normalise(vectors: Points) -> Points:
    """Scale vectors (n, 3) to unit length; a zero vector becomes +z."""
    with np.errstate(invalid="ignore"):  # NaN stays NaN
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
    zero = length == 0
    return np.where(zero, [0.0, 0.0, 1.0], vectors / np.where(zero, 1.0, length))

"""What every field promises."""

import numpy as np


class Field:
    """An approximation of a mesh's signed distance and unit normal.

    Subclasses implement ``answer(points)`` in the unit frame.

    Attributes
    ----------
    name : str
        As in the configuration.
    frame : pandis.frame.Frame
    bytes : int
        What a program must hold in memory to answer.
    """

    def __init__(self, name, frame, size):
        self.name, self.frame, self.bytes = name, frame, size

    def distance_and_normal(self, points):
        """Answer in mesh units.

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

    def answer(self, points):
        """Answer distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        raise TypeError(f"{type(self).__name__} must implement answer()")


def clamp_to_box(points):
    """Move points into [-1, 1]³.

    Returns
    -------
    clamped : ndarray, shape (n, 3)
    outside : ndarray, shape (n,)
        How far each point was moved: added to the distance at the clamped
        point it is an upper bound that stays positive, so that no field makes
        a ghost contact far from its box.
    """
    clamped = np.clip(points, -1.0, 1.0)
    return clamped, np.linalg.norm(points - clamped, axis=1)


def normalise(vectors):
    """Scale vectors (n, 3) to unit length; a zero vector becomes +z."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    zero = length == 0
    return np.where(zero, [0.0, 0.0, 1.0], vectors / np.where(zero, 1.0, length))

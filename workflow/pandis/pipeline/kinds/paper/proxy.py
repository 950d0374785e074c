"""[22]: a contact point tracked on the zero level of any field.

Salisbury & Tarr 1997 let a virtual contact point slide on the surface, and pull the device to it
with a spring. Their abstract gives the idea: a tangent plane follows the contact, and the device
does not pass it. The tracking steps follow the same group's programs as far as these are described.
Where the paper is silent, they are inferred.
"""

import numpy as np

from pandis.pipeline.kinds.field import Field, normalise

#: Maximum number of Newton steps onto the surface, and the step size (unit frame) that ends them.
_STEPS, _NEAR = 10, 1e-9


class ProxyField(Field):
    """Distance and direction to a tracked contact point.

    Answers depend on the probe's path: the points of a call are processed in order, and there is
    no contact before the first. The force -k·distance·normal is then k·(contact point - probe).

    Parameters
    ----------
    name : str
    field : Field
        Its zero level is the surface. It also supplies the normals.
    """

    ordered = True

    def __init__(self, name, field):
        super().__init__(name, field.frame, field.bytes)
        self.field = field

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) along a path (n, 3), all in the unit frame."""
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        contact = None
        free, free_normal = self.field.answer(points)
        for index, probe in enumerate(points):
            contact = self._track(contact, probe, free[index])
            if contact is None:
                distance[index], normal[index] = max(free[index], 0.0), free_normal[index]
            else:
                pull = contact - probe
                distance[index] = -np.linalg.norm(pull)
                normal[index] = normalise(pull[None])[0]
        bad = np.isnan(points).any(axis=1)
        distance[bad], normal[bad] = np.nan, np.nan
        return distance, normal

    def _track(self, contact, probe, distance):
        """Return the next contact point (3,), or None if the probe is out of contact."""
        if not np.isfinite(probe).all():
            return contact
        if contact is None:
            return self._project(probe) if distance < 0 else None
        _, normal = self.field.answer(contact[None])
        along = (probe - contact) @ normal[0]
        if along > 0:
            return None  # the probe has left through the tangent plane: contact is lost
        return self._project(probe - along * normal[0])

    def _project(self, start):
        """Return the point on the surface that Newton's method reaches from ``start``."""
        point = start
        for _ in range(_STEPS):
            distance, normal = self.field.answer(point[None])
            point = point - distance[0] * normal[0]
            if abs(distance[0]) < _NEAR:
                break
        return point

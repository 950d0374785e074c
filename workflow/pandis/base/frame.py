"""The unit frame, in which every stage computes.

The bounding box is centred at 0 and its longest side is 1.8: the shape spans
[-0.9, 0.9], which leaves a margin in the box [-1, 1]³.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

UNIT_SIDE = 1.8


class Frame(NamedTuple):
    """The similarity transform from mesh units to the unit frame.

    Attributes
    ----------
    centre : tuple of float
        Centre of the bounding box, mesh units.
    scale : float
        Unit-frame length of one mesh unit.
    """

    centre: tuple[float, float, float]
    scale: float

    def to_unit(self, points) -> NDArray[np.float64]:
        """Map points (..., 3) in mesh units to the unit frame, in float64."""
        return (np.asarray(points, np.float64) - self.centre) * self.scale

    def to_mesh(self, points) -> NDArray[np.float64]:
        """Map points (..., 3) in the unit frame to mesh units, in float64."""
        return np.asarray(points, np.float64) / self.scale + self.centre

    def attributes(self):
        """Return the frame as an entry of an artifact's attributes."""
        frame = {"centre": list(self.centre), "scale": self.scale, "unit_side": UNIT_SIDE}
        return {"frame": frame}

    @classmethod
    def of(cls, artifact):
        """Return the frame of a `pandis.pipeline.run.job.artifact.Artifact`."""
        frame = artifact.attributes["frame"]
        return cls(tuple(frame["centre"]), frame["scale"])

    @classmethod
    def of_bounds(cls, low, high) -> "Frame":
        """Return the frame of a box given by its corners (3,) in mesh units."""
        low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        centre = low + (high - low) / 2
        return cls(tuple(centre.tolist()), float(UNIT_SIDE / (high - low).max()))


#: The identity transform, for points that are already in the unit frame.
UNIT = Frame((0.0, 0.0, 0.0), 1.0)

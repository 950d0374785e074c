"""[16]: the nearest support plane, and the surface below it from the plane's distance map."""

import numpy as np

from pandis.base.frame import Frame
from pandis.pipeline.kinds.field import Field, clamp_to_box, normalise
from pandis.pipeline.kinds.paper.maps import plane_axes


class PlanesField(Field):
    """Support planes in three readings, selected by name.

    See `pandis.pipeline.kinds.paper.spec.PLANES`.

    ``support-planes-only`` uses the nearest plane alone; ``support-planes-distance`` adds the depth
    of the surface below it; ``support-planes`` also tilts the normal by the slope of the map. The
    method is meant for convex bodies. For any other body it stores only the outermost surface.

    Parameters
    ----------
    name : str
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``planes``.
    """

    def __init__(self, name, artifact):
        arrays = {key: value.astype(np.float64) for key, value in artifact.arrays.items()}
        self.normals, self.offsets, self.radius = (
            arrays[k] for k in ("normals", "offsets", "radius")
        )
        self.axes = plane_axes(self.normals)
        self.maps = artifact.arrays["maps"] if name != "support-planes-only" else None
        self.tilted = name == "support-planes"
        size = sum(value.nbytes for key, value in artifact.arrays.items() if key != "maps")
        size += self.maps.nbytes if self.maps is not None else 0
        super().__init__(name, Frame.of(artifact), size)

    def answer(self, points):
        """Return distance (n,) and normal (n, 3) at points (n, 3), all in the unit frame."""
        points = np.asarray(points, np.float64)
        bad = np.isnan(points).any(axis=1)
        points, outside = clamp_to_box(np.where(bad[:, None], 0.0, points))
        above = points @ self.normals.T - self.offsets
        nearest = above.argmax(axis=1)
        distance, normal = above[np.arange(len(points)), nearest], self.normals[nearest]
        if self.maps is not None:
            one, other = (axis[nearest] for axis in self.axes)
            place = np.stack([(points * one).sum(1), (points * other).sum(1)], axis=1)
            depth, slope = self._look_up(nearest, place)
            below = distance <= 0  # outside a plane, the plane itself is the closer bound
            distance = np.where(below, distance + depth, distance)
            if self.tilted:
                tilt = slope[:, :1] * one + slope[:, 1:] * other
                normal = normalise(np.where(below[:, None], normal + tilt, normal))
        return np.where(bad, np.nan, distance + outside), np.where(bad[:, None], np.nan, normal)

    def _look_up(self, plane, place):
        """Return depth (n,) and slope (n, 2) of the maps, by cubic convolution (Keys 1981)."""
        size = self.maps.shape[1]
        spacing = 2 * self.radius / (size - 1)
        position = np.clip((place + self.radius) / spacing, 1.0, size - 2 - 1e-9)
        base = np.floor(position).astype(np.int64)
        weights, rates = _keys(position - base)
        depth, slope = np.zeros(len(place)), np.zeros((len(place), 2))
        for i in range(4):
            for j in range(4):
                value = self.maps[plane, base[:, 0] + i - 1, base[:, 1] + j - 1]
                depth += weights[i][:, 0] * weights[j][:, 1] * value
                slope[:, 0] += rates[i][:, 0] * weights[j][:, 1] * value
                slope[:, 1] += weights[i][:, 0] * rates[j][:, 1] * value
        return depth, slope / spacing


def _keys(t):
    """Return the weights of four nodes at t in [0, 1), and their derivatives."""
    weights = [
        0.5 * (-t + 2 * t**2 - t**3),
        0.5 * (2 - 5 * t**2 + 3 * t**3),
        0.5 * (t + 4 * t**2 - 3 * t**3),
        0.5 * (-(t**2) + t**3),
    ]
    rates = [
        0.5 * (-1 + 4 * t - 3 * t**2),
        0.5 * (-10 * t + 9 * t**2),
        0.5 * (1 + 8 * t - 9 * t**2),
        0.5 * (-2 * t + 3 * t**2),
    ]
    return weights, rates

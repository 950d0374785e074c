"""The base: a coarse spline of the distance over the whole box, which a network corrects."""

import numpy as np
from scipy.interpolate import BSpline

from pandis.engine.spline import EDGE, Lattice

#: The spline is fitted to this many exact distances per cell along each axis.
_SAMPLES = 3


class BaseSpline:
    """A tricubic B-spline of a few KB over the box [-1, 1]³.

    Parameters
    ----------
    coefficients : ndarray, shape (cells + 3, cells + 3, cells + 3), float32
        At nodes from one cell before the box to one after it.
    """

    def __init__(self, coefficients):
        self.coefficients = np.ascontiguousarray(coefficients, np.float32)
        self.lattice = Lattice.around_box(len(coefficients) - 3)

    def evaluate(self, points):
        """Return the values (n,) and gradients (n, 3) at points (n, 3) in the box, float64."""
        return self.lattice.evaluate(self.coefficients, np.clip(points, -EDGE, EDGE))


def fit_base(engine, cells):
    """Return the spline fitted to the distance by least squares over the box.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    cells : int
        Cells per axis.

    Returns
    -------
    BaseSpline

    Notes
    -----
    Samples and spline are tensor products, so the problem can be solved one axis at a time
    (de Boor 1979, Efficient computer manipulation of tensor products).
    """
    axis = np.linspace(-1, 1, _SAMPLES * cells + 1)
    places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    distance = engine.distance_and_normal(places.reshape(-1, 3))[0].reshape(places.shape[:3])
    knots = -1 + 2 / cells * np.arange(-3, cells + 4)
    design = BSpline.design_matrix(np.minimum(axis, EDGE), knots, 3).toarray()
    solve = np.linalg.pinv(design)
    for _ in range(3):  # solves for the first axis, and moves it to the end
        distance = np.tensordot(distance, solve, axes=(0, 1))
    return BaseSpline(distance)

"""Fits tricubic splines to exact distances so that the error of the force is small.

Inside, at signed distance d, the force is -d·n. The error of a spline f with
gradient g is about √((f - d)² + d²·|g - n|²) there. The fit minimises the sum
of the errors over sample points, not the sum of their squares. Next to the medial
axis no smooth function fits, and a sum of squares would reduce the errors there at
the expense of the fit elsewhere. The method is iteratively reweighted least squares
with conjugate gradients.
"""

from typing import NamedTuple

import numpy as np

#: Error below which a point's weight does not increase further.
_FLOOR = 1e-4
#: Damping, relative to the mean weight. It keeps coefficients without samples unchanged.
_DAMPING = 1e-3


class Targets(NamedTuple):
    """Targets of a fit: exact distances and directions at points, and their weights."""

    points: np.ndarray
    distance: np.ndarray
    normal: np.ndarray
    weight: np.ndarray


class Level:
    """The nodes of one lattice whose coefficients may differ from zero.

    Parameters
    ----------
    lattice : pandis.engine.spline.Lattice
    nodes : ndarray, shape (m,)
        Flat indices of the nodes.
    """

    def __init__(self, lattice, nodes):
        self.lattice, self.nodes = lattice, nodes

    def evaluate(self, coefficients, points):
        """Return value and gradient at points from the coefficients (m,) of the nodes."""
        dense = np.zeros(self.lattice.size**3, np.float32)
        dense[self.nodes] = coefficients
        return self.lattice.evaluate(dense.reshape((self.lattice.size,) * 3), points)

    def adjoint(self, points, value, gradient):
        """Apply the transpose of `evaluate` to residuals at points; return (m,)."""
        return self.lattice.adjoint(points, value, gradient)[self.nodes]


def evaluate(levels, coefficients, points):
    """Return value (n,) and gradient (n, 3) of the sum of levels."""
    value, gradient = np.zeros(len(points)), np.zeros((len(points), 3))
    for level, part in zip(levels, coefficients, strict=True):
        more = level.evaluate(part, points)
        value += more[0]
        gradient += more[1]
    return value, gradient


def residual(levels, coefficients, targets):
    """Return the force error (n,) of a sum of levels at the targets."""
    value, gradient = evaluate(levels, coefficients, targets.points)
    squares = ((gradient - targets.normal) ** 2).sum(axis=1)
    return np.sqrt((value - targets.distance) ** 2 + _depth(targets) ** 2 * squares)


def fit(levels, coefficients, targets, *, rounds, steps, report=None):
    """Improve coefficients by iteratively reweighted least squares.

    Parameters
    ----------
    levels : list of Level
    coefficients : list of ndarray
        Initial coefficients of each level.
    targets : Targets
    rounds, steps : int
        Number of reweightings, and of conjugate gradient steps in each.
    report : callable, optional
        Called with the number of steps done.

    Returns
    -------
    list of ndarray
    """
    depth = _depth(targets)
    ends = np.cumsum([len(part) for part in coefficients])[:-1]

    def forward(x):
        return evaluate(levels, np.split(x, ends), targets.points)

    def backward(value, gradient):
        return np.concatenate([v.adjoint(targets.points, value, gradient) for v in levels])

    x = np.concatenate([np.asarray(part, np.float64) for part in coefficients])
    for turn in range(rounds):
        value, gradient = forward(x)
        off, turned = targets.distance - value, targets.normal - gradient
        error = np.sqrt(off**2 + depth**2 * (turned**2).sum(axis=1))
        # the first round is plain least squares: its start is too inaccurate for useful weights
        flat = targets.weight / np.maximum(error, _FLOOR) if turn else targets.weight / 1e-3
        steep = (flat * depth**2)[:, None]
        damping = _DAMPING * flat.mean()
        rest = backward(flat * off, steep * turned)
        way, step = rest.copy(), np.zeros_like(x)
        length = _product(rest, rest)
        for index in range(steps):
            if length == 0:
                break
            along_value, along_gradient = forward(way)
            image = backward(flat * along_value, steep * along_gradient) + damping * way
            amount = length / _product(way, image)
            step += amount * way
            rest -= amount * image
            now = _product(rest, rest)
            way = rest + now / length * way
            length = now
            if report:
                report(turn * steps + index + 1)
        x = x + step
    return np.split(x, ends)


def _product(one, other):
    """Return the inner product of two vectors, by NumPy's own sum.

    BLAS adds in an order that depends on the number of its threads.
    """
    return (one * other).sum()


def _depth(targets):
    """Return the weights (n,) of direction errors: the forces' magnitudes, 0 outside."""
    return np.maximum(-targets.distance, 0.0)

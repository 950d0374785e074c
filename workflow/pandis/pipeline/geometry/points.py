"""Points on which fields are chosen, and separate points on which the choice is judged.

Whichever field is best on a set of points has smaller errors there than elsewhere. Promised errors
are therefore not measured on the points used for the choice.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from pandis.base.streams import generator
from pandis.pipeline.geometry.measure import draw_contacts, promise
from pandis.pipeline.geometry.sampling import HELD_OUT
from pandis.pipeline.run.ask.budget import Limits, describe_figures, describe_force

#: Number of points on which promised errors are measured.
PROMISED = 2 * HELD_OUT
#: Numbers that, after the seed, select random streams. There are three per stream, and the last
#: is not zero: streams of training points have two numbers, and a trailing zero changes nothing.
_CHOOSING, _PROMISING = (11, 0, 1), (12, 0, 1)


class Measured(NamedTuple):
    """Errors of a candidate, and whether they are within the limits.

    Attributes
    ----------
    figures : dict
        ``mean``, ``p99`` and ``missing``. They are measured on `Points.promising`, or on
        `Points.choosing` if the candidate already exceeds a limit there.
    why : str
        Why the candidate does not meet the limits; empty if it does.
    excess : float
        Largest ratio of an error to its limit. It is at most 1 if the candidate meets the limits.
    """

    figures: dict
    why: str
    excess: float


class Points:
    """Points on which one mesh's fields are chosen, and points for measuring promised errors.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    scale : pandis.base.physical.Scale
    seed : int
    """

    def __init__(self, body, scale, seed):
        self.body, self.scale, self.seed = body, scale, seed

    @cached_property
    def choosing(self):
        """The contact set on which fields are chosen."""
        return self._draw(HELD_OUT, _CHOOSING)

    @cached_property
    def promising(self):
        """The contact set on which promised errors are measured."""
        return self._draw(PROMISED, _PROMISING)

    def _draw(self, count, stream):
        rng = generator(self.seed, *stream)
        return draw_contacts(self.body, self.scale, count, rng=rng)

    @cached_property
    def mean_force(self):
        """Mean exact force on the deep contact set, unit frame."""
        force = np.linalg.norm(self.promising.sets["contact-deep"].force, axis=1)
        return float(force.mean()) if len(force) else 0.0

    def limits(self, target):
        """Return the `pandis.pipeline.run.ask.budget.Limits` of a target."""
        return Limits.of(target, self.scale.newtons, self.mean_force)

    def describe(self, figures):
        """Describe a field's errors, as `describe_figures` does."""
        return describe_figures(figures, self.scale.newtons, self.mean_force)

    def describe_limits(self, limits):
        """Describe the limits on mean, p99 and missing surface."""
        mean = describe_force(limits.mean, self.scale.newtons, self.mean_force)
        tail = f"{1e3 * self.scale.newtons * limits.tail:.3g} mN at p99"
        return f"{mean} on average, {tail}, {100 * limits.missed:.2g} % of the surface missing"

    def measure(self, force_at, limits=None):
        """Measure a field's errors, and compare them with limits if given.

        Parameters
        ----------
        force_at : callable
            Returns the force (n, 3) at points (n, 3), unit frame, k = 1.
        limits : pandis.pipeline.run.ask.budget.Limits, optional

        Returns
        -------
        Measured
        """
        if limits is not None:
            figures, _ = promise(force_at, self.choosing)
            if limits.excess(figures) > 1:
                return Measured(figures, self.describe(figures), limits.excess(figures))
        figures, upper = promise(force_at, self.promising)
        if limits is None:
            return Measured(figures, "", 0.0)
        excess = limits.excess(upper)
        close = "" if limits.excess(figures) > 1 else ", too close to the limits to be promised"
        return Measured(figures, self.describe(figures) + close if excess > 1 else "", excess)

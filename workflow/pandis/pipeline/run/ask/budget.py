"""Converts the user's limits on a field's force errors, such as 20 mN, to the unit frame.

The planning process imports this module, so it must import neither torch nor trimesh.
"""

import math
import re
from typing import NamedTuple

#: Pattern of an amount of force: in mN or N on the configured device, or in % of the mean force.
AMOUNT = r"\d+(\.\d*)?([eE][+-]?\d+)? *(mN|N|%)"
#: Default limit on the tail (99th percentile), as a multiple of the limit on the mean.
TAIL = 10.0


def amount(value):
    """Return the number and unit of an amount: ``mN``, ``N``, ``%`` or, in the unit frame, empty.

    Raises
    ------
    ValueError
        The value is not an amount of force above zero.
    """
    text, unit = str(value).strip(), ""
    if isinstance(value, str) and re.fullmatch(AMOUNT, text):
        unit = re.search("(mN|N|%)$", text)[1]
        text = text.removesuffix(unit).strip()
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if isinstance(value, bool) or not 0 < number < float("inf"):
        raise ValueError(
            "an amount of force is a number above zero (unit frame, k = 1), such as 0.001, or a "
            "text such as '20 mN', '0.02 N' or '5 %' (of the mean force)"
        )
    return number, unit


class Limits(NamedTuple):
    """Largest errors allowed for a field, on the contact set down to a depth of 0.04.

    Attributes
    ----------
    mean, tail : float
        Mean and 99th percentile of ‖F − F_exact‖; unit frame, k = 1.
    missed : float
        Share of the area on which the force may be missing.
    """

    mean: float
    tail: float
    missed: float

    @classmethod
    def of(cls, target, newtons, mean_force):
        """Return the limits set by the options ``force_error``, ``tail`` and ``missed``.

        Parameters
        ----------
        target : BudgetOptions, GridTarget or ExactRecipe
        newtons : float
            Newtons per unit of force in the unit frame (k = 1).
        mean_force : float
            Mean of the exact force on the contact set, unit frame.
        """
        mean, tail = _in_unit_frame(target.force_error, newtons, mean_force), target.tail
        tail = TAIL * mean if tail is None else _in_unit_frame(tail, newtons, mean_force)
        return cls(mean, tail, target.missed)

    def excess(self, figures):
        """Return the largest ratio of a figure to its limit; infinity if a figure is NaN.

        Parameters
        ----------
        figures : dict
            ``mean``, ``p99`` and ``missing``: see
            `pandis.pipeline.geometry.measure.contact_errors`.
        """
        pairs = zip((figures["mean"], figures["p99"], figures["missing"]), self, strict=True)
        ratios = [value / limit for value, limit in pairs]
        return float("inf") if any(map(math.isnan, ratios)) else max(ratios)


def _in_unit_frame(value, newtons, mean_force):
    number, unit = amount(value)
    return number * {"mN": 1e-3 / newtons, "N": 1 / newtons, "%": mean_force / 100, "": 1.0}[unit]


def describe_force(force, newtons, mean_force):
    """Describe an amount of force in all three units: millinewtons, percent, unit frame."""
    percent = 100 * force / mean_force if mean_force else float("nan")
    words = f"{percent:.2g} % of the mean force, {force:.3g} in the unit frame"
    return f"{1e3 * newtons * force:.3g} mN ({words})"


def describe_figures(figures, newtons, mean_force):
    """Describe a field's errors: mean, tail, and surface that lacks force or cannot be judged."""
    lacks = (
        f"lacks the force on {100 * figures['missing']:.3g} % of the surface "
        f"({100 * figures['left_out']:.3g} % of it is too thin to be judged)"
    )
    if figures["left_out"] >= 1:
        lacks = "cannot be judged, because all of the surface is too thin"
    return (
        f"has a force error of {describe_force(figures['mean'], newtons, mean_force)} on average "
        f"and of {1e3 * newtons * figures['p99']:.3g} mN at p99, and {lacks}"
    )

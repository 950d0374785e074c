"""Data of the page's three-dimensional view of a mesh: short integers, as text."""

import base64
import json

import numpy as np

#: Number of powers of ten that the colours span, down from the largest errors.
DECADES = 3
#: Integer steps per unit of length, and from the first colour to the last.
_STEPS, _COLOURS = 32767, 255


def view(arrays, newtons, names, *, first):
    """Return the text of a JSON object for ``view.js``.

    Parameters
    ----------
    arrays : dict of str to ndarray
        The arrays of ``evaluation.zarr.zip``.
    newtons : float
        Newtons per unit of force in the unit frame.
    names : list of str
        Fields whose errors can be chosen.
    first : str
        The field that is shown first.

    Returns
    -------
    str
        ``vertices``, ``faces`` and each of ``paths``: little-endian integers in base 64, positions
        in 1/32767 of the unit frame; ``errors``: by field, per vertex, a byte from 0 (10^low mN or
        less) to 255 (10^high mN or more); ``low``, ``high``, ``first``; ``small``: whether
        the indices in ``faces`` have 16 bits instead of 32.
    """
    errors = {n: arrays[f"view_error_{n}"] for n in names if f"view_error_{n}" in arrays}
    scale = 1e3 * newtons
    largest = max((np.percentile(e, 99.5) * scale for e in errors.values()), default=0.0)
    high = float(np.ceil(2 * np.log10(max(largest, 1e-6))) / 2)
    with np.errstate(divide="ignore"):
        shades = {n: (np.log10(e * scale) - high) / DECADES + 1 for n, e in errors.items()}
    small = len(arrays["view_vertices"]) < 1 << 16
    return json.dumps(
        {
            "vertices": _text(arrays["view_vertices"] * _STEPS, "<i2"),
            "faces": _text(arrays["view_faces"], "<u2" if small else "<u4"),
            "small": small,
            "paths": [_text(path * _STEPS, "<i2") for path in arrays["paths"]],
            "errors": {n: _text(s.clip(0, 1) * _COLOURS, "u1") for n, s in shades.items()},
            "low": high - DECADES,
            "high": high,
            "first": first if first in errors else next(iter(errors), ""),
        },
        sort_keys=True,
    )


def _text(values, kind):
    whole = np.rint(values) if np.issubdtype(values.dtype, np.floating) else values
    return base64.b64encode(np.ascontiguousarray(whole).astype(kind).tobytes()).decode()

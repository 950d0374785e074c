"""Figures of the page in three forms: SVG to view, PDF to print, and CSV with the numbers."""

import base64
import io
import re
from itertools import zip_longest
from typing import NamedTuple
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import LogFormatterSciNotation

mpl.rcParams["svg.hashsalt"] = "pandis"
mpl.rcParams["svg.fonttype"] = "none"
mpl.rcParams["font.size"] = 9
mpl.rcParams["axes.spines.top"] = mpl.rcParams["axes.spines.right"] = False

#: Characters left unescaped in a URI within an attribute, so that it is shorter than in base 64.
_SAFE = " !$()*+,-./:;=?@[]_~{}|^"


class Picture(NamedTuple):
    """A figure of the report.

    Attributes
    ----------
    svg, pdf : str
        ``data:`` URIs.
    csv : str
        The plotted numbers; empty if an artifact contains them.
    """

    svg: str
    pdf: str
    csv: str


def save(figure, numbers=None, dpi=110):
    """Return a matplotlib figure as a Picture.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    numbers : dict of str to sequence, optional
        Columns of the table of numbers; they may differ in length.
    dpi : int
        Resolution of rasterised parts, dots per inch.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
                axis.set_major_formatter(_Powers())
            if isinstance(axis.get_minor_formatter(), LogFormatterSciNotation):
                axis.set_minor_formatter(_Powers())
    figure.draw_without_rendering()
    figure.set_layout_engine(None)  # freeze the layout: it is the same in both files
    box = figure.get_tightbbox().padded(mpl.rcParams["savefig.pad_inches"])
    svg = _written(figure, "svg", dpi, box=box, Date=None).decode()
    pdf = _written(figure, "pdf", dpi, box=box, CreationDate=None)
    return Picture(
        f"data:image/svg+xml,{quote(svg, safe=_SAFE)}",
        f"data:application/pdf;base64,{base64.b64encode(pdf).decode()}",
        _csv(numbers or {}),
    )


class _Powers(LogFormatterSciNotation):
    """Writes powers of ten in plain characters, ten times as fast as formulas are laid out."""

    _RAISED = str.maketrans("0123456789-\N{MINUS SIGN}", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")

    def __call__(self, x, pos=None):
        formula = super().__call__(x, pos)
        plain = re.sub(r"\^\{(.*?)\}", lambda power: power[1].translate(self._RAISED), formula)
        return re.sub(r"\$|\\mathdefault|[{}]", "", plain).replace(r"\times", "×")


def _written(figure, form, dpi, *, box, **metadata):
    stream = io.BytesIO()
    figure.savefig(stream, format=form, dpi=dpi, metadata=metadata, bbox_inches=box)
    return stream.getvalue()


def _csv(numbers):
    lines = [",".join(f'"{name}"' for name in numbers)] if numbers else []
    for row in zip_longest(*numbers.values(), fillvalue=""):
        lines.append(",".join(_cell(value) for value in row))
    return "\n".join(lines)


def _cell(value):
    if isinstance(value, str):
        return value
    return f"{value:.6g}" if isinstance(value, float | np.floating) else str(value)

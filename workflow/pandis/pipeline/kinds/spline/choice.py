"""Tries splines for `fields: auto`, and makes those whose queries are timed."""

from pandis.pipeline.kinds.spline.search import SplineMaker

#: Sizes, in bytes, of the splines in the table of query times.
_TIMED = (50_000, 800_000)


def choose(chooser):
    """See `pandis.pipeline.kinds`."""
    band = chooser.options.band
    maker = SplineMaker(chooser.points, band, chooser.progress)
    return chooser.first([maker], "{form}-auto")


def timed(torus):
    """See `pandis.pipeline.kinds`."""
    for size in _TIMED:
        maker = SplineMaker(torus.points, torus.band, torus.progress, most=size)
        yield maker.form, size, lambda maker=maker, size=size: maker.make(size).field

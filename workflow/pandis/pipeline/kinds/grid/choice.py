"""Grids for `fields: auto`, and the times of their queries."""

from pandis.pipeline.kinds.grid.search import GridMaker
from pandis.pipeline.kinds.grid.spec import TRIED

#: Nodes per axis of the grids in the table of query times.
_TIMED = (16, 64, 128)


def choose(chooser):
    """Try grids of every interpolation together, smallest first: see `pandis.pipeline.kinds`."""
    makers = [
        GridMaker(form, chooser.points, chooser.options.band, progress=chooser.progress)
        for form in TRIED
    ]
    return chooser.first(makers, "{form}-{size}")


def timed(torus):
    """See `pandis.pipeline.kinds`."""
    for form in TRIED:
        maker = GridMaker(form, torus.points, torus.band, progress=torus.progress)
        for size in _TIMED:
            yield form, size, lambda maker=maker, size=size: maker.make(size).field

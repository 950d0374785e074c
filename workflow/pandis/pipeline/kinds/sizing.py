"""Grids of which the user names what they should achieve, not how large they are."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.pipeline.kinds.field import Field
from pandis.pipeline.kinds.grid.build import CHANNELS, DenseGrid
from pandis.pipeline.kinds.grids import GRID_OPENERS
from pandis.pipeline.kinds.spline.build import SplineFit, samples_for
from pandis.pipeline.run.ask.catalogue import BOX, GRID_FIELDS
from pandis.pipeline.run.job.artifact import Artifact

#: Nodes per axis that are tried, coarse to fine; bytes of the splines.
SIZES = (16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)
SPLINE_BYTES = tuple(50_000 * 2**k for k in range(8))
#: No error falls faster than with this power of the spacing: what would need that is not built.
_FASTEST = 4


class Candidate(NamedTuple):
    """A grid that was made.

    Attributes
    ----------
    field : pandis.pipeline.kinds.field.Field
    arrays, attributes : dict
        As stored in its artifact, except the frame.
    """

    field: Field
    arrays: dict
    attributes: dict

    def force(self, points):
        """Answer the force (n, 3) at points (n, 3), unit frame, k = 1."""
        return penalty_force(*self.field.answer(points))


class Grids:
    """Makes grids of one mesh, of any kind and size.

    Parameters
    ----------
    points : pandis.pipeline.judge.errors.points.Points
    frame : dict
        Attributes of the mesh's frame.
    band : tuple of float
        See `pandis.pipeline.kinds.band.Band`.
    progress : callable
        Makes a `pandis.pipeline.run.job.stage.Progress`.
    largest : int
        Bytes of the largest spline that may be asked for.
    """

    def __init__(self, points, frame, band, progress, largest=SPLINE_BYTES[-1]):
        self.points, self.frame, self.band = points, frame, band
        self.progress, self.largest = progress, largest

    @cached_property
    def _splines(self):
        # a search over sizes draws once, for the largest
        points = self.points
        samples = samples_for(budget=self.largest)
        return SplineFit(points.engine, points.surface, self.band, points.seed, samples)

    def make(self, kind, size):
        """Return the `Candidate` of a kind and size; None if the size is too small for the band.

        Parameters
        ----------
        kind : str
            A key of `pandis.pipeline.run.ask.catalogue.GRID_FIELDS`.
        size : int
            Nodes per axis; bytes of a spline.
        """
        if kind == "spline":
            nodes = self._splines.choose_size(size)
            if nodes is None:
                return None
            arrays, attributes = self._splines.build(nodes, size, self.progress)
        else:
            content, engine = GRID_FIELDS[kind], self.points.engine
            grid = DenseGrid(engine, content, size, self.band, self.progress)
            arrays = {"values": np.concatenate(list(grid.slabs(32)))}
            attributes = grid.attributes()
        artifact = Artifact(None, "grid", arrays, attributes | self.frame.attributes(), {}, "")
        return Candidate(GRID_OPENERS[kind](kind, artifact), arrays, attributes)


def grid_bytes(kind, size):
    """Return the bytes that ``pandis.h`` answers a grid from; of a spline they are its size."""
    if kind == "spline":
        return size
    nodes = size + 2 if kind == "tricubic" else size  # the cells at the border have theirs, too
    return 4 * CHANNELS[GRID_FIELDS[kind].removesuffix(BOX)] * nodes**3


def hopeless(size, figures, limits, other, kind):
    """Tell whether a larger grid of a kind cannot meet limits either, by the error of a smaller.

    Parameters
    ----------
    size, other : int
        Of the one that was measured, and of the other.
    figures : dict
    limits : pandis.pipeline.run.ask.budget.Limits
    kind : str
    """
    finer = (other / size) ** (0.5 if kind == "spline" else 1.0)
    return figures["mean"] > limits.mean * finer**_FASTEST


class Sizing:
    """Searches the size of one kind of grid, for `…-auto`.

    Parameters
    ----------
    points : pandis.pipeline.judge.errors.points.Points
    frame : pandis.base.frame.Frame
    options : pandis.pipeline.run.ask.tasks.BakeAutoTask
    progress : callable
        Makes a `pandis.pipeline.run.job.stage.Progress`.
    log : callable
    """

    def __init__(self, points, frame, options, progress, log):
        self.kind, self.points, self.options, self.log = options.kind, points, options, log
        largest = options.bytes or SPLINE_BYTES[-1]
        self.grids = Grids(points, frame, options.band, progress, largest)
        self.what = f"{options.kind}-auto (bake.auto.{options.kind})"

    def find(self):
        """Return arrays and attributes of the grid; ``sizing`` says which sizes were tried.

        Raises
        ------
        PandisError
            No size meets the error, or fits into the bytes.
        """
        budget = self.options.bytes
        if budget is not None:
            candidate = self._largest_within(budget)
            tried = [(self._size_of(candidate, budget), self.points.measure(candidate.force))]
        else:
            candidate, tried = self._smallest()
        asked = self.options.model_dump(include={"force_error", "tail", "missed", "bytes"})
        figures = tried[-1][1].figures
        self.log(f"{self.kind}-auto: {self.points.told(figures)}")
        sizing = {
            "asked": asked,
            "tried": [{"size": s, "force_error": m.figures["mean"]} for s, m in tried],
            "held_out_error": figures["mean"],
            "held_out": figures,
        }
        return candidate.arrays, candidate.attributes | {"sizing": sizing}

    def _size_of(self, candidate, budget):
        return budget if self.kind == "spline" else len(candidate.arrays["values"])

    def _largest_within(self, budget):
        if self.kind == "spline":
            candidate = self.grids.make("spline", budget)
            if candidate is None:
                raise PandisError(f"{self.what}: no spline of {budget:,} bytes covers the band")
            return candidate
        fitting = [size for size in range(2, 513) if grid_bytes(self.kind, size) <= budget]
        if not fitting:
            raise PandisError(f"{self.what}: no grid fits into {budget:,} bytes")
        return self.grids.make(self.kind, fitting[-1])

    def _smallest(self):
        """Return the first size, from small to large, that meets the limits, and all tried."""
        limits, tried = self.points.limits(self.options), []
        for size in SPLINE_BYTES if self.kind == "spline" else SIZES:
            if any(hopeless(s, m.figures, limits, size, self.kind) for s, m in tried):
                continue
            candidate = self.grids.make(self.kind, size)
            if candidate is None:
                self.log(f"{self.kind} of size {size:,}: does not cover the band")
                continue
            measured = self.points.measure(candidate.force, limits)
            tried.append((size, measured))
            self.log(f"{self.kind} of size {size:,}: {self.points.told(measured.figures)}")
            if not measured.why:
                return candidate, tried
        if not tried:
            raise PandisError(f"{self.what}: no size that is tried could come near what is asked")
        size, best = min(tried, key=lambda one: one[1].excess)
        raise PandisError(
            f"{self.what}: no size meets {self.points.told_limits(limits)}; the nearest, "
            f"{size:,}, {best.why}: ask for less, or for another kind of field"
        )

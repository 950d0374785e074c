"""Grids of which the user names what they should achieve, not how large they are."""

import numpy as np

from pandis.artifact import Artifact
from pandis.catalogue import GRID_FIELDS
from pandis.errors import PandisError
from pandis.fields.grids import GRID_OPENERS
from pandis.forces import penalty_force
from pandis.grids.dense import CHANNELS, DenseGrid
from pandis.grids.search import SIZES, coarsest, force_error
from pandis.grids.spline import SplineFit, samples_for
from pandis.sampling import held_out

#: Bytes of the splines that are tried for an error.
SPLINE_BYTES = tuple(50_000 * 2**k for k in range(8))


class Sizing:
    """Searches the size of one kind of grid.

    Parameters
    ----------
    kind : str
        A key of `pandis.catalogue.GRID_FIELDS`.
    engine : object
        From `pandis.distance.open_distance`.
    surface : pandis.sampling.Surface
    frame : dict
        Attributes of the mesh's frame.
    options : dict
        ``band``, ``seed`` and one of ``force_error``, ``bytes``.
    progress : callable
        Makes a `pandis.stage.Progress`.
    log : callable
    """

    def __init__(self, kind, engine, surface, frame, options, progress, log):
        self.kind, self.engine, self.surface, self.frame = kind, engine, surface, frame
        self.options, self.progress, self.log = options, progress, log
        self.points, *exact = held_out(surface, engine, options["seed"])
        self.force = penalty_force(*exact)
        self.made = {}
        if kind == "spline":
            # a search over sizes draws once, for the largest
            budget = options["bytes"] or SPLINE_BYTES[-1]
            samples = samples_for(budget=budget)
            self.splines = SplineFit(engine, surface, options["band"], options["seed"], samples)

    def find(self):
        """Return arrays and attributes of the grid: see `make`."""
        wanted, budget = self.options["force_error"], self.options["bytes"]
        what = f"{self.kind}-auto (bake.auto.{self.kind})"
        if wanted is not None:
            sizes = SPLINE_BYTES if self.kind == "spline" else SIZES
            size, errors = coarsest(sizes, self.measure, wanted, what)
        else:
            size, errors = self._within(budget, what), {}
            errors[size] = self.measure(size)
        arrays, attributes = self.made[size]
        tried = [
            {"size": s, "force_error": errors[s]} for s in sorted(errors) if errors[s] < np.inf
        ]
        asked = {"force_error": wanted, "bytes": budget}
        sizing = {"asked": asked, "tried": tried, "held_out_error": errors[size]}
        return arrays, attributes | {"sizing": sizing}

    def _within(self, budget, what):
        if self.kind == "spline":
            if self.splines.choose_size(budget) is None:
                raise PandisError(f"{what}: no spline of {budget:,} bytes covers the band")
            return budget
        each = 4 * CHANNELS[GRID_FIELDS[self.kind]]
        fitting = [size for size in range(2, 513) if each * size**3 <= budget]
        if not fitting:
            raise PandisError(f"{what}: no grid fits into {budget:,} bytes")
        return fitting[-1]

    def measure(self, size):
        """Make the grid of a size, keep it in ``made``, and return its error on held-out points."""
        made = self.make(size)
        if made is None:
            self.log(f"{self.kind} of size {size:,}: does not cover the band")
            return np.inf
        self.made[size] = made
        attributes = made[1] | {"frame": self.frame}
        artifact = Artifact(None, "grid", made[0], attributes, {}, "")
        error = force_error(GRID_OPENERS[self.kind](self.kind, artifact), self.points, self.force)
        self.log(f"{self.kind} of size {size:,}: mean force error {error:.3e}")
        return error

    def make(self, size):
        """Return arrays and attributes of a grid, as stored; None if the size is too small.

        Parameters
        ----------
        size : int
            Nodes per axis; bytes for a spline.
        """
        if self.kind == "spline":
            nodes = self.splines.choose_size(size)
            return nodes and self.splines.build(nodes, size, self.progress)
        content = GRID_FIELDS[self.kind]
        grid = DenseGrid(self.engine, content, size, self.options["band"], self.progress)
        values = np.concatenate(list(grid.slabs(32)))
        return {"values": values}, grid.attributes()

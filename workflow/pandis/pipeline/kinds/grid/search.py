"""Finds a grid size that meets the given limits."""

import numpy as np

from pandis.pipeline.kinds.grid.dense import CHANNELS, DenseGrid
from pandis.pipeline.kinds.grid.reference import open_field
from pandis.pipeline.kinds.grid.spec import BOX, CONTENTS, KIND
from pandis.pipeline.kinds.sizing import Candidate, Maker, points_of, write_sized
from pandis.pipeline.run.job.artifact import Artifact

#: Maximum nodes per axis, however large the budget.
_LARGEST = 512


class GridMaker(Maker):
    """Makes grids of one mesh; a size is a number of nodes per axis.

    Parameters
    ----------
    form : str
        A key of `CONTENTS`.
    points : pandis.pipeline.geometry.points.Points
    band : tuple of float
        See `pandis.pipeline.kinds.band.Band`.
    progress : pandis.base.progress.Progress
    """

    sizes = (16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256)

    def __init__(self, form, points, band, *, progress):
        self.form, self.points, self.band, self.progress = form, points, band, progress

    def make(self, size):
        """See `Maker.make`."""
        body = self.points.body
        grid = DenseGrid(
            body.distance, CONTENTS[self.form], size, band=self.band, progress=self.progress
        )
        arrays = {"values": np.concatenate(list(grid.slabs(32)))}
        attributes = grid.attributes()
        artifact = Artifact("grid", arrays, attributes | body.frame.attributes())
        spec = KIND.parse(f"{self.form}-{size}", None)
        return Candidate(open_field(spec, artifact), arrays, attributes)

    def largest(self, budget):
        """See `Maker.largest`."""
        fitting = (size for size in range(_LARGEST, 3, -1) if self.bytes_of(size) <= budget)
        return next(fitting, None)

    def bytes_of(self, size):
        """See `Maker.bytes_of`."""
        return grid_bytes(self.form, size)

    def finer(self, size, other):
        """See `Maker.finer`."""
        return other / size


def grid_bytes(form, size):
    """Return the bytes that ``pandis.h`` needs to query a grid."""
    nodes = size + 2 if form == "tricubic" else size  # border cells need one more per side
    return 4 * CHANNELS[CONTENTS[form].removesuffix(BOX)] * nodes**3


def build(job):
    """Find the size of one grid, and write ``grid-{form}-auto.zarr.zip``.

    Raises
    ------
    PandisError
        See `pandis.pipeline.kinds.sizing.search`.
    """
    task = job.options
    maker = GridMaker(task.form, points_of(job), task.band, progress=job.progress)
    write_sized(job, maker, "grid")

"""Fits the spline for a given number of bytes, or the smallest that meets the error limits."""

from functools import cached_property

from pandis.pipeline.kinds.sizing import Candidate, Maker, points_of, write_sized
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.kinds.spline.reference import SplineField
from pandis.pipeline.run.job.artifact import Artifact


class SplineMaker(Maker):
    """Makes splines of one mesh. Its sizes are numbers of bytes.

    Parameters
    ----------
    points : pandis.pipeline.geometry.points.Points
    band : tuple of float
        See `pandis.pipeline.kinds.band.Band`.
    progress : pandis.base.progress.Progress
    most : int
        Size of the largest spline that may be requested, in bytes.
    """

    form = "spline"
    sizes = tuple(50_000 * 2**k for k in range(8))

    def __init__(self, points, band, progress, *, most=sizes[-1]):
        self.points, self.band = points, band
        self.progress, self.most = progress, most

    @cached_property
    def _fit(self):
        # samples are drawn once per search, enough for the largest size
        points, samples = self.points, samples_for(budget=self.most)
        return SplineFit(points.body, self.band, points.seed, count=samples)

    def make(self, size):
        """See `Maker.make`."""
        nodes = self._fit.choose_size(size)
        if nodes is None:
            return None
        arrays, attributes = self._fit.build(nodes, size, self.progress)
        frame = self.points.body.frame.attributes()
        artifact = Artifact("grid", arrays, attributes | frame)
        return Candidate(SplineField(self.form, artifact), arrays, attributes)

    def largest(self, budget):
        """See `Maker.largest`."""
        return budget

    def bytes_of(self, size):
        """See `Maker.bytes_of`."""
        return size

    def finer(self, size, other):
        """See `Maker.finer`: blocks are near the surface, so bytes grow as 1 / spacing²."""
        return (other / size) ** 0.5


def build(job):
    """Find the size of one spline, and write ``grid-spline-auto.zarr.zip``.

    Raises
    ------
    PandisError
        See `pandis.pipeline.kinds.sizing.search`.
    """
    most = job.options.target.bytes or SplineMaker.sizes[-1]
    maker = SplineMaker(points_of(job), job.options.band, job.progress, most=most)
    write_sized(job, maker, "grid")

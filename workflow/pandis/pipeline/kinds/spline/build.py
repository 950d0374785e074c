"""Fits a spline with a given number of nodes."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for


def build(job):
    """Fit one spline, and write ``grid-spline-{size}.zarr.zip``."""
    body, task = Body.open(job.read("mesh", "mesh")), job.options
    samples = samples_for(task.size)
    spline = SplineFit(body, task.band, task.seed, count=samples)
    arrays, attributes = spline.build(task.size, None, job.progress)
    job.write("grid", arrays, attributes | body.frame.attributes())

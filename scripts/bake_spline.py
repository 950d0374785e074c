"""Fit one spline. Reads mesh.zarr.zip, writes grid-spline-{size}.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.spline.build import SplineFit, samples_for
from pandis.pipeline.run.ask.tasks import BakeSplineTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, BakeSplineTask) as job:
    mesh = job.read("mesh", "mesh")
    body, task = Body.open(mesh), job.options
    samples = samples_for(task.size)
    spline = SplineFit(body.distance, body.surface, task.band, task.seed, samples)
    arrays, attributes = spline.build(task.size, None, job.progress)
    job.write("grid", arrays, attributes | body.frame.attributes())

"""Trace the probe's path. Reads mesh.zarr.zip, writes trajectory.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.trajectories import trace
from pandis.pipeline.run.ask.tasks import TrajectoryTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, TrajectoryTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    seed = job.options.seed
    arrays, attributes = trace(body, job.options, seed, progress=job.progress)
    if attributes["followed"]:
        job.log(attributes["followed"])
    job.write("trajectory", arrays, attributes | body.frame.attributes())

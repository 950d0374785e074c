"""Trace the probe's path. Reads mesh.zarr.zip, writes trajectory.zarr.zip."""

from pandis.geometry.body import Body
from pandis.geometry.trajectories import trace
from pandis.run.stage import stage
from pandis.run.tasks import TrajectoryTask

with stage(snakemake, TrajectoryTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    seed = job.options.seed
    arrays, attributes = trace(body.surface, body.distance, job.options, seed, job.progress)
    if attributes["followed"]:
        job.log(attributes["followed"])
    job.write("trajectory", arrays, attributes | body.frame.attributes())

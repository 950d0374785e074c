"""Trace the probe's path. Reads mesh.zarr.zip, writes trajectory.zarr.zip."""

from pandis.geometry.body import Body
from pandis.geometry.trajectories import trace
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    arrays, attributes = trace(body.surface, body.distance, job.options, job.progress)
    if attributes["followed"]:
        job.log(attributes["followed"])
    job.write("trajectory", arrays, attributes | {"frame": mesh.attributes["frame"]})

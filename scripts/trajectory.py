"""Trace the probe's path. Reads mesh.zarr.zip, writes trajectory.zarr.zip."""

from pandis.geometry.distance import open_distance
from pandis.geometry.sampling import open_surface
from pandis.geometry.trajectories import trace
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine = open_distance(mesh)
    arrays, attributes = trace(open_surface(mesh, engine), engine, job.options, job.progress)
    if attributes["followed"]:
        job.log(attributes["followed"])
    job.write("trajectory", arrays, attributes | {"frame": mesh.attributes["frame"]})

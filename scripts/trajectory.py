"""Trace the probe's path. Reads mesh.zarr.zip, writes trajectory.zarr.zip."""

from pandis.distance import open_distance
from pandis.sampling import open_surface
from pandis.stage import stage
from pandis.trajectories import trace

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine = open_distance(mesh)
    arrays = trace(open_surface(mesh, engine), engine, job.options, job.progress)
    job.write("trajectory", arrays, {"frame": mesh.attributes["frame"]})

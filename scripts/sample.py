"""Draw and label training points. Reads mesh.zarr.zip, writes samples.zarr.zip."""

from pandis.distance import open_distance
from pandis.sampling import open_surface, sample
from pandis.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine = open_distance(mesh)
    arrays, attributes = sample(open_surface(mesh, engine), engine, job.options, job.progress)
    job.write("samples", arrays, attributes | {"frame": mesh.attributes["frame"]})

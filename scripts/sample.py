"""Draw and label training points. Reads mesh.zarr.zip, writes samples.zarr.zip."""

from pandis.geometry.distance import open_distance
from pandis.geometry.sampling import open_surface
from pandis.geometry.strata import Strata
from pandis.run.stage import stage

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine = open_distance(mesh)
    strata = Strata(open_surface(mesh, engine), engine, job.options)
    attributes = strata.attributes() | {"frame": mesh.attributes["frame"]}
    job.write_pieces("samples", strata.columns(), strata.shards(job.progress), attributes)

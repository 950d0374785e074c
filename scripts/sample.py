"""Draw and label training points. Reads mesh.zarr.zip, writes samples.zarr.zip."""

from pandis.distance import open_distance
from pandis.sampling import open_surface
from pandis.stage import stage
from pandis.strata import Strata

with stage(snakemake) as job:
    mesh = job.read("mesh", "mesh")
    engine = open_distance(mesh)
    strata = Strata(open_surface(mesh, engine), engine, job.options)
    attributes = strata.attributes() | {"frame": mesh.attributes["frame"]}
    job.write_pieces("samples", strata.columns(), strata.shards(job.progress), attributes)

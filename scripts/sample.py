"""Draw and label training points. Reads mesh.zarr.zip, writes samples.zarr.zip."""

from pandis.geometry.body import Body
from pandis.geometry.strata import Strata
from pandis.run.stage import stage
from pandis.run.tasks import SampleTask

with stage(snakemake, SampleTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    strata = Strata(body.surface, body.distance, job.options, job.options.seed)
    attributes = strata.attributes() | body.frame.attributes()
    job.write_pieces("samples", strata.columns(), strata.shards(job.progress), attributes)

"""Draw and label training points. Reads mesh.zarr.zip, writes samples.zarr.zip."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.run.ask.tasks import SampleTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SampleTask) as job:
    mesh = job.read("mesh", "mesh")
    body = Body.open(mesh)
    strata = Strata(body, job.options, job.options.seed)
    attributes = strata.attributes() | body.frame.attributes()
    job.write_pieces(
        "samples", strata.columns(), strata.shards(job.progress), attributes=attributes
    )

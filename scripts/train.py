"""Train a field. Reads mesh.zarr.zip and samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.pipeline.run.ask.kinds import build_task, kind_module
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, build_task) as job:
    kind_module(job.options.kind, "build").build(job)

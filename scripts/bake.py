"""Build a field's data. Reads mesh.zarr.zip, writes {artifact}.zarr.zip."""

from pandis.pipeline.run.ask.kind import SearchTask
from pandis.pipeline.run.ask.kinds import build_task, kind_module
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, build_task) as job:
    kind, searched = job.options.kind, isinstance(job.options, SearchTask)
    module = kind_module(kind, "search") if searched else kind_module(kind, "build")
    module.build(job)

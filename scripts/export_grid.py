"""Export one grid field. Reads grid-….zarr.zip, writes export/{field}.onnx."""

from pandis.pipeline.kinds.grid.graph import export_grid
from pandis.pipeline.run.ask.tasks import ExportTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportTask) as job:
    grid = job.read("grid", "grid")
    job.write_file(export_grid(job.options.field, grid, job.provenance(), job.log))

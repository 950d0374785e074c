"""Export one grid field. Reads grid-….zarr.zip, writes export/{field}.onnx."""

from pandis.export.grids import export_grid
from pandis.run.stage import stage
from pandis.run.tasks import ExportTask

with stage(snakemake, ExportTask) as job:
    grid = job.read("grid", "grid")
    job.write_file(export_grid(job.options.field, grid, job.provenance(), job.log))

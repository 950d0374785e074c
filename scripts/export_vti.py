"""Write one grid field as VTK image data. Reads grid-….zarr.zip, writes export/{field}.vti."""

from pandis.pipeline.export.vti import export_vti
from pandis.pipeline.run.ask.tasks import ExportTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportTask) as job:
    grid = job.read("artifact", "grid")
    job.write_file(export_vti(job.options.field, grid, job.provenance()))

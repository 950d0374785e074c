"""Write one grid field as VTK image data. Reads grid-….zarr.zip, writes export/{field}.vti."""

from pandis.export.vti import export_vti
from pandis.run.stage import stage
from pandis.run.tasks import ExportTask

with stage(snakemake, ExportTask) as job:
    grid = job.read("grid", "grid")
    job.write_file(export_vti(job.options.field, grid, job.provenance()))

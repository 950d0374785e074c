"""Write distances for Newton's cache. Reads mesh.zarr.zip, writes export/newton.npz."""

from pandis.export.newton import export_newton
from pandis.geometry.body import Body
from pandis.run.stage import stage
from pandis.run.tasks import ExportNewtonTask

with stage(snakemake, ExportNewtonTask) as job:
    body = Body.open(job.read("mesh", "mesh"))
    job.write_file(export_newton(body, job.options.size, job.provenance(), job.log, job.progress))

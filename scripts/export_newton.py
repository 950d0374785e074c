"""Write distances for Newton's cache. Reads mesh.zarr.zip, writes export/newton.npz."""

from pandis.pipeline.export.newton import export_newton
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.run.ask.tasks import ExportNewtonTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportNewtonTask) as job:
    body = Body.open(job.read("mesh", "mesh"))
    job.write_file(
        export_newton(body, job.options.size, job.provenance(), log=job.log, progress=job.progress)
    )

"""Read and repair one mesh. Reads its source, writes mesh.zarr.zip."""

from pandis.pipeline.mesh.build import build
from pandis.pipeline.run.ask.sourcing import source_path
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, MeshTask) as job:
    files = [job.note_file(path) for path in job.input]
    path = files[0] if files else source_path(job.options.source)
    if path is not None:
        job.check_source(path)
    job.write("mesh", *build(job.options, path, job.log))

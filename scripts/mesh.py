"""Read and repair one mesh. Reads its source, writes mesh.zarr.zip."""

from pandis.mesh.build import build
from pandis.run.sourcing import source_path
from pandis.run.stage import stage
from pandis.run.tasks import MeshTask

with stage(snakemake, MeshTask) as job:
    files = [job.note_file(path) for path in job.input]
    path = files[0] if files else source_path(job.options.source)
    if path is not None:
        job.check_source(path)
    job.write("mesh", *build(job.options, path, job.log))

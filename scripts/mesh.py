"""Read and repair one mesh. Reads its source, writes mesh.zarr.zip."""

from pandis.mesh.build import build
from pandis.stage import stage

with stage(snakemake) as job:
    files = [job.note_file(path) for path in job.input]
    job.write("mesh", *build(job.options, files[0] if files else None, job.log))

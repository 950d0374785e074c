"""Put everything on one page. Writes results/report.html."""

from pathlib import Path

from pandis.report.page import build, mesh_sections
from pandis.report.seal import seal
from pandis.run.stage import stage
from pandis.run.tasks import SummaryTask

with stage(snakemake, SummaryTask) as job:
    meshes = {
        mesh: ([path for path in job.input if Path(path).parent.name == mesh], fields)
        for mesh, fields in job.options.fields.items()
    }
    sections = mesh_sections(meshes, job.threads, job.progress, job.note_digest)
    job.write_file(seal(build(sections), job.provenance()).encode())
    # what an earlier run had to leave out is in now
    Path(job.output[0]).with_name("refused.json").unlink(missing_ok=True)

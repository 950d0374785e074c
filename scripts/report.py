"""Put all results on one page. Writes results/report.html."""

from pathlib import Path

from pandis.pipeline.report.page import build, mesh_sections
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import SummaryTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SummaryTask) as job:
    folder = Path(job.output[0]).parent
    meshes = {
        mesh: ([path for path in job.input if folder / mesh in Path(path).parents], fields)
        for mesh, fields in job.options.fields.items()
    }
    sections = mesh_sections(meshes, job.threads, job.progress, note=job.note_digest)
    job.write_file(seal(build(sections).encode(), job.provenance(), ".html"))
    # no mesh is refused now, so remove the list that an earlier run may have written
    Path(job.output[0]).with_name("refused.json").unlink(missing_ok=True)

"""Put everything on one page. Writes results/report.html."""

from pathlib import Path

from pandis.report.page import build, mesh_section
from pandis.report.seal import seal
from pandis.stage import stage

with stage(snakemake) as job:
    fields, sections = job.options["fields"], []
    progress = job.progress("pages", len(fields), "meshes")
    for index, mesh in enumerate(fields):
        paths = [path for path in job.input if Path(path).parent.name == mesh]
        sections.append(mesh_section(mesh, [job.read_path(p) for p in paths], fields[mesh]))
        progress.update(index + 1)
    job.write_file(seal(build(sections), job.provenance()).encode())
    # what an earlier run had to leave out is in now
    Path(job.output[0]).with_name("refused.json").unlink(missing_ok=True)

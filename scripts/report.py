"""Put everything on one page. Writes results/report.html."""

from pandis.report.page import build, mesh_section
from pandis.report.seal import seal
from pandis.stage import stage

with stage(snakemake) as job:
    fields, sections = job.options["fields"], []
    progress = job.progress("pages", len(fields), "meshes")
    for index, mesh in enumerate(fields):
        paths = [path for path in job.input if path.startswith(f"results/{mesh}/")]
        sections.append(mesh_section(mesh, [job.read_path(p) for p in paths], fields[mesh]))
        progress.update(index + 1)
    job.write_file(seal(build(sections), job.provenance()).encode())

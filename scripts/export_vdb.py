"""Write the fields of a mesh as volumes. Reads export/*.pandis, writes export/fields.vdb."""

from pandis.export.volumes import export_volumes
from pandis.report.seal import seal
from pandis.run.stage import stage
from pandis.run.tasks import ExportVdbTask

with stage(snakemake, ExportVdbTask) as job:
    data = export_volumes([job.note_file(path) for path in job.input.exports], job.log)
    job.write_file(seal(data, job.provenance(), ".vdb"))

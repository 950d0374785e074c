"""Write a mesh's fields as volumes. Reads export/*.pandis, writes export/fields.vdb."""

from pandis.pipeline.export.volumes import export_volumes
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import ExportVdbTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportVdbTask) as job:
    data = export_volumes([job.note_file(path) for path in job.input.exports], job.log)
    job.write_file(seal(data, job.provenance(), ".vdb"))

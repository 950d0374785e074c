"""Write a model for MuJoCo. Reads export/*.pandis and mesh.obj, writes export/mujoco.xml."""

from pandis.pipeline.export.mjcf import export_mjcf
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import ExportMjcfTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportMjcfTask) as job:
    files = [job.note_file(path) for path in job.input.exports]
    drawn = job.note_file(job.input.drawn)
    text = export_mjcf(job.mesh, files, drawn, size=job.options.size, log=job.log)
    job.write_file(seal(text.encode(), job.provenance(), ".xml"))

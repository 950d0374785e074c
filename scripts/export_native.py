"""Export one field for pandis.h. Reads its artifact, writes export/{field}.pandis."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.tasks import ExportNativeTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportNativeTask) as job:
    task, name = job.options, job.options.field
    field = open_field(known_field(name), job.read_path(job.input.artifact))
    body = Body.open(job.read("mesh", "mesh"))
    job.write_file(export_native(field, body, task, provenance=job.provenance(), log=job.log))

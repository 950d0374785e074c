"""Export one field for pandis.h. Reads what holds it, writes export/{field}.pandis."""

from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import kind_of, open_field
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.tasks import ExportNativeTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportNativeTask) as job:
    task, name = job.options, job.options.field
    held, spec = job.read_path(job.input.held), parse_field(name, [name])
    field, kind = open_field(spec, held), kind_of(spec, held)
    body = Body.open(job.read("mesh", "mesh"))
    asked = task.weight_bits, body, job.log, task.original_faces
    job.write_file(export_native(field, kind, job.provenance(), *asked))

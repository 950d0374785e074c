"""Export one field as a graph or a program. Reads its artifact, writes export/{field}.{ending}."""

from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kinds import kind_module
from pandis.pipeline.run.ask.tasks import ExportTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportTask) as job:
    name, artifact = job.options.field, job.read_path(job.input.artifact)
    exports = kind_module(known_field(name).kind, "exports").EXPORTS
    export = exports[snakemake.wildcards.ending]
    job.write_file(export(name, artifact, job.provenance(), log=job.log))

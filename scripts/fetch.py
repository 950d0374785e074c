"""Download one mesh. Writes source.{extension}, checked against the configuration's sha256."""

from pandis.pipeline.mesh.fetch import fetch
from pandis.pipeline.run.ask.tasks import FetchTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, FetchTask) as job:
    job.write_file(fetch(job.options.url, job.options.sha256, job.progress))

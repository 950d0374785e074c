"""Download one mesh. Writes source.{extension}, checked against the configuration's sha256."""

from pandis.mesh.fetch import fetch
from pandis.run.stage import stage
from pandis.run.tasks import FetchTask

with stage(snakemake, FetchTask) as job:
    job.write_file(fetch(job.options.url, job.options.sha256, job.progress))

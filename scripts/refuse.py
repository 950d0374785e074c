"""Report why a mesh cannot be built, and fail. Writes nothing."""

from pandis.base.errors import PandisError
from pandis.pipeline.run.ask.tasks import RefuseTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, RefuseTask) as job:
    raise PandisError(job.options.why)

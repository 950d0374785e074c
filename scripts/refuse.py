"""Say why a mesh cannot be built, and fail. Writes nothing."""

from pandis.errors import PandisError
from pandis.run.stage import stage
from pandis.run.tasks import RefuseTask

with stage(snakemake, RefuseTask) as job:
    raise PandisError(job.options.why)

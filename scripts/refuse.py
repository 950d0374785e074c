"""Say why a mesh cannot be built, and fail. Writes nothing."""

from pandis.errors import PandisError
from pandis.run.stage import stage

with stage(snakemake) as job:
    raise PandisError(job.options["why"])

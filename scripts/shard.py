"""Label the meshes of one shard of a data set. Writes shards/{shard}.zarr.zip."""

from pandis.pipeline.dataset.shards import ShardBuilder
from pandis.pipeline.run.ask.tasks import ShardTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ShardTask) as job:
    shard = ShardBuilder(job.options, job.output[0], code=job.code_of_fields, log=job.log)
    shard.compute(job.threads, job.progress)
    job.write_pieces("shard", shard.columns(), shard.pieces(), attributes=shard.attributes())
    shard.remember()

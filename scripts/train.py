"""Train one network. Reads samples.zarr.zip, writes model-{recipe}.zarr.zip."""

from pandis.stage import stage
from pandis.training.trainer import Trainer

with stage(snakemake) as job:
    samples = job.read("samples", "samples")
    trainer = Trainer(job.options, samples, job.checkpoint(), job.log)
    arrays, attributes = trainer.run(job.progress)
    job.write("model", arrays, attributes | {"frame": samples.attributes["frame"]})
    trainer.finish()

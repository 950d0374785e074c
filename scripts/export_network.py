"""Export one network. Reads model-{recipe}.zarr.zip, writes export/{recipe}.onnx."""

from pandis.export.networks import export_network
from pandis.stage import stage

with stage(snakemake) as job:
    model = job.read("model", "model")
    job.write_file(export_network(job.options["field"], model, job.provenance(), job.log))

"""Export one network. Reads model-{recipe}.zarr.zip, writes export/{recipe}.onnx and .pt2."""

from pandis.pipeline.kinds.network.graph import export_network
from pandis.pipeline.kinds.network.program import export_program
from pandis.pipeline.run.ask.tasks import ExportTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, ExportTask) as job:
    model = job.read("model", "model")
    for index, export in enumerate((export_network, export_program)):
        data = export(job.options.field, model, job.provenance(), job.log)
        job.write_file(data, index)

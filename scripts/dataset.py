"""List the meshes of a data set. Reads its shards, writes index.zarr.zip, card.html, card.json."""

from pandis.pipeline.dataset.card import build, to_json
from pandis.pipeline.dataset.index import collect, forget
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import DatasetTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, DatasetTask) as job:
    arrays, record = collect(job.input, job.options, note=job.note_digest)
    job.write("dataset", arrays, record.attributes())
    page = build(record, job.input)
    job.write_file(seal(page.encode(), job.provenance(), ".html"), 1)
    job.write_file(to_json(record), 2)
    forget(job.input)

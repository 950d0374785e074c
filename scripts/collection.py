"""List a collection of meshes in one table. Writes results/collection.html and collection.csv."""

import hashlib
from pathlib import Path

from pandis.pipeline.report.collection import build, collect, to_csv
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import SummaryTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, SummaryTask) as job:
    folder = Path(job.output[0]).parent
    meshes = {mesh: [] for mesh in job.options.fields}
    for path in job.input:
        meshes[Path(path).relative_to(folder).parts[0]].append(path)
    rows = collect(meshes, job.threads, job.progress, note=job.note_digest)
    table = to_csv(rows).encode()
    # the page's seal covers the table beside it
    why = job.provenance() | {"table": hashlib.sha256(table).hexdigest()}
    job.write_file(seal(build(rows).encode(), why, ".html"))
    job.write_file(table, 1)
    # no mesh is refused now, so remove the list that an earlier run may have written
    Path(job.output[0]).with_name("refused.json").unlink(missing_ok=True)

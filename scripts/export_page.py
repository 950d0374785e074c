"""Put a mesh's exported fields on a web page. Reads export/*.pandis, writes export/touch.html."""

from pandis.bridges.web import STIFFEST, page, with_proxies
from pandis.pipeline.report.seal import seal
from pandis.pipeline.run.ask.tasks import ExportPageTask
from pandis.pipeline.run.job.stage import stage
from pandis.runtime.field import NativeField

with stage(snakemake, ExportPageTask) as job:
    fields = with_proxies([NativeField(job.note_file(path)) for path in job.input.exports], job.log)
    stiffness = min(job.options.stiffness, STIFFEST)
    if stiffness < job.options.stiffness:
        job.log(f"the page starts at {stiffness:g} N/m, the largest stiffness that it supports")
    text = page(job.mesh, fields, job.options.size, stiffness=stiffness)
    job.write_file(seal(text.encode(), job.provenance(), ".html"))

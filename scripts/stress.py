"""Run the stress suite on all fields of a mesh. Writes stress.zarr.zip."""

from pandis.base.physical import Scale
from pandis.pipeline.judge.controls import controls
from pandis.pipeline.judge.stress.suite import Suite, stress
from pandis.pipeline.kinds.opening import open_fields
from pandis.pipeline.run.ask.tasks import StressTask
from pandis.pipeline.run.job.stage import stage

with stage(snakemake, StressTask) as job:
    mesh = job.read("mesh", "mesh")
    fields = open_fields(job.options.fields, mesh, map(job.read_input, job.input.fields))
    suite = Suite(fields.body, Scale.of(job.options), job.options, seed=job.options.seed)
    tried = controls(fields.exact, suite.scale)
    arrays, attributes = stress(
        fields, tried, suite, count=job.threads, progress=job.progress, proxies=job.options.proxies
    )
    for key, how in (("failed", ""), ("proxies_failed", " through a proxy")):
        for name, failed in attributes[key].items():
            job.log(f"{name}{how}: " + (f"fails {', '.join(failed)}" if failed else "passes"))
    job.write("stress", arrays, attributes)

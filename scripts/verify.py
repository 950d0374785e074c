"""Check the whole chain of results against the configuration; exit with status 1 on a mismatch."""

from pandis.pipeline.check.verification import demand_files, verify
from pandis.pipeline.run.ask.tasks import VerifyTask
from pandis.pipeline.run.job.stage import stage
from pandis.pipeline.run.plan.plan import Plan

with stage(snakemake, VerifyTask) as job:
    demand_files(job.options.store)
    verify(Plan(snakemake.config, job.workflow(), job.options.configfiles), job.log)

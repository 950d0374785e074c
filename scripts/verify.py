"""Check the whole chain of results against the configuration; exit 1 on a mismatch."""

from pandis.run.plan import Plan
from pandis.run.stage import stage
from pandis.run.tasks import VerifyTask
from pandis.run.verification import demand_files, verify

with stage(snakemake, VerifyTask) as job:
    demand_files(job.options.store)
    verify(Plan(snakemake.config, job.workflow(), job.options.configfiles), job.log)

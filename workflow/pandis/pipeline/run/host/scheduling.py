"""Corrects the default behaviour of Snakemake's scheduler."""

#: Snakemake's default limit: jobs, and the seconds in which they may start.
_DEFAULT = (100, 1)


def wait_for_jobs(workflow):
    """Make Snakemake look for jobs only when one has ended, not on a timer as well.

    By default Snakemake 9.27 starts at most a hundred jobs per second. Each time it looks for jobs
    it also sets a timer to look again a second later, so every job that ends adds one look per
    second for the rest of the run. With hundreds of jobs, looking occupies a whole core and starts
    none of them sooner. A limit other than the default (``--max-jobs-per-timespan``) is kept.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == _DEFAULT:
        workflow.scheduler.job_rate_limiter = None

"""Corrects the default behaviour of Snakemake's scheduler."""

#: Snakemake's default limit: how many jobs may start, and in how many seconds.
_DEFAULT = (100, 1)


def wait_for_jobs(workflow):
    """Make Snakemake search for ready jobs only when a job has ended, and not also on a timer.

    By default Snakemake 9.27 starts at most a hundred jobs per second. Each search for jobs also
    sets a timer for another search a second later, so every job that ends adds one search per
    second for the rest of the run. With hundreds of jobs, these searches occupy a whole core and
    start no job sooner. A limit other than the default (``--max-jobs-per-timespan``) is kept.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == _DEFAULT:
        workflow.scheduler.job_rate_limiter = None

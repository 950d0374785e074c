"""What Snakemake's scheduler does of itself, and should not."""

#: Snakemake's own limit: jobs in so many seconds.
_DEFAULT = (100, 1)


def wait_for_jobs(workflow):
    """Let the scheduler look for jobs to start only when one has ended.

    Snakemake 9.27 counts jobs per second, by default at most a hundred. Whenever it looks, it sets
    a timer to look again a second later, so that every job that ends makes it look once a second
    more, for the rest of the run. Of hundreds of jobs none is found any faster: looking for them
    takes a core of its own. Another limit (``--max-jobs-per-timespan``) is left as it is.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == _DEFAULT:
        workflow.scheduler.job_rate_limiter = None

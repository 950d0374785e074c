"""Support for Slurm beyond the profile: which command reports that a job has ended."""

import re
import subprocess
import sys

from pandis.base.errors import PandisError

#: Seconds for which `squeue` must list a job after its end. Snakemake checks every few seconds,
#: but the controller may restart in between.
REMEMBERED = 200
#: Options of Snakemake within a job: run rules locally, and count memory for all of them together.
_HERE = "--executor local --set-resource-scopes mem_mb=global"


def status_command():
    """Return the command that reports how jobs of this cluster ended, and `MinJobAge`.

    Returns
    -------
    command : str
        ``squeue`` if it lists a job long enough after its end (`MinJobAge`), with or without an
        accounting database. Otherwise ``sacct``, if there is a database. ``sacct`` comes second
        because it reports a cancelled job as "CANCELLED by" a user, which Snakemake's plugin 2.8.0
        takes for a running job.
    age : int
        `MinJobAge`, seconds.

    Raises
    ------
    PandisError
        Neither command would report the end of a job, so Snakemake would wait forever.
    """
    shown = _ask("scontrol", "show", "config").stdout
    age = re.search(r"^MinJobAge\s*=\s*(\d+)", shown, re.M)
    if age is None:
        raise PandisError("no Slurm cluster answers here: `scontrol show config` fails")
    if int(age[1]) >= REMEMBERED:
        return "squeue", int(age[1])
    accounts = _ask("sacct", "--noheader", "--allocations", "--starttime=now")
    if accounts.returncode == 0:
        return "sacct", int(age[1])
    errors = accounts.stderr.strip().splitlines()
    raise PandisError(
        f"no command here reports that a job has ended: squeue forgets a job {age[1]} s after "
        f"its end (MinJobAge in slurm.conf; {REMEMBERED} are needed), and the cluster has no "
        f"accounting database (sacct: {errors[-1] if errors else 'no answer'})"
    )


def listen(workflow):
    """Set the command by which Snakemake's Slurm plugin learns that jobs have ended.

    By default the plugin calls `sacct` wherever that is installed. Without a database `sacct` has
    no result, and the run never ends. Jobs of a run with this plugin use Snakemake's local
    executor, and their status is checked every ``seconds-between-status-checks``.
    """
    if workflow.executor_plugin is None or workflow.executor_plugin.name != "slurm":
        return
    try:
        workflow.executor_settings.status_command, age = status_command()
    except PandisError as error:
        # a PandisError would make Snakemake print a traceback
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    plugin = sys.modules["snakemake_executor_plugin_slurm"]
    # The plugin reads MinJobAge each time. If the controller is down, it takes the failure for a
    # short MinJobAge and uses `sacct` from then on.
    plugin.get_min_job_age = lambda: age
    # Within a job the plugin would start Snakemake for every rule of a group, one after the other.
    # Started once, Snakemake runs in parallel whatever fits into the job's resources. (In an array
    # of jobs, only the plugin's own arguments identify the running job.)
    if not workflow.executor_settings.array_jobs:
        inherited = plugin.Executor.get_job_args
        plugin.Executor.additional_general_args = lambda _: _HERE
        plugin.Executor.get_job_args = lambda executor, job: (
            f"{inherited(executor, job)} {_room(job)}"
        )
    # By default the pause between checks grows to up to three minutes while no job ends.
    pause = workflow.remote_execution_settings.seconds_between_status_checks
    plugin.Executor.next_seconds_between_status_checks = property(
        lambda _: pause, lambda _, longer: None
    )


def _room(job):
    """Return the job's resources as arguments for the Snakemake that runs within it."""
    memory = job.resources.get("mem_mb")
    return f"--cores {job.threads}" + f" --resources mem_mb={memory}" * isinstance(memory, int)


def _ask(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))

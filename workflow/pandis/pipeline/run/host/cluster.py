"""What a run on a Slurm cluster has to know beside its profile: who tells that a job has ended."""

import re
import subprocess
import sys

from pandis.base.errors import PandisError

#: Seconds for which `squeue` has to know a job after its end: Snakemake asks every few seconds, but
#: the controller may have to start anew in between.
REMEMBERED = 200
#: How Snakemake runs the rules of a job: where it is, and memory counts for all of them.
_HERE = "--executor local --set-resource-scopes mem_mb=global"


def status_command():
    """Return the command that tells how the jobs of this cluster end, and `MinJobAge`.

    Returns
    -------
    command : str
        ``squeue`` where it still knows a job long enough after its end (`MinJobAge`), with an
        accounting database or without. Otherwise ``sacct``, if there is a database: of a job that
        somebody cancels it says "CANCELLED by" whom, which Snakemake's plugin 2.8.0 takes for a
        job that runs.
    age : int
        Seconds.

    Raises
    ------
    PandisError
        Neither would tell. Snakemake would wait forever.
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
        f"nothing here tells Snakemake that a job has ended: squeue forgets a job {age[1]} s after "
        f"its end (MinJobAge in slurm.conf; {REMEMBERED} are needed), and the cluster keeps no "
        f"accounting database (sacct: {errors[-1] if errors else 'no answer'})"
    )


def listen(workflow):
    """Let Snakemake's Slurm plugin, if this run uses it, ask a command that will answer.

    The plugin asks `sacct` wherever that is installed. Without a database it never answers, and
    the run never ends. Its jobs are run by Snakemake's local executor, and it asks as often as
    ``seconds-between-status-checks`` says.
    """
    if workflow.executor_plugin is None or workflow.executor_plugin.name != "slurm":
        return
    try:
        workflow.executor_settings.status_command, age = status_command()
    except PandisError as error:
        # Snakemake would print a traceback around it
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    plugin = sys.modules["snakemake_executor_plugin_slurm"]
    # The plugin asks for MinJobAge each time. While the controller is away it gets no answer,
    # treats that as a short memory, and falls back to `sacct` for good.
    plugin.get_min_job_age = lambda: age
    # Within a job it would start Snakemake anew for every rule of a group, one after the other.
    # Started a single time, it runs side by side whatever fits into what the job has asked for.
    # (Of an array of jobs only the plugin's own way knows which one it is.)
    if not workflow.executor_settings.array_jobs:
        inherited = plugin.Executor.get_job_args
        plugin.Executor.additional_general_args = lambda _: _HERE
        plugin.Executor.get_job_args = lambda executor, job: (
            f"{inherited(executor, job)} {_room(job)}"
        )
    # It would pause for longer and longer while no job ends, up to three minutes.
    pause = workflow.remote_execution_settings.seconds_between_status_checks
    plugin.Executor.next_seconds_between_status_checks = property(
        lambda _: pause, lambda _, longer: None
    )


def _room(job):
    """Return arguments that tell the Snakemake of a job what has been asked for."""
    memory = job.resources.get("mem_mb")
    return f"--cores {job.threads}" + f" --resources mem_mb={memory}" * isinstance(memory, int)


def _ask(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))

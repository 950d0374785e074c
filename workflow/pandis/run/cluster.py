"""What a run on a Slurm cluster has to know beside its profile: who tells that a job has ended."""

import re
import subprocess
import sys

from pandis.errors import PandisError

#: Seconds that may pass between two questions of Snakemake's Slurm plugin, and some to spare.
LONGEST_PAUSE = 200


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
    if int(age[1]) >= LONGEST_PAUSE:
        return "squeue", int(age[1])
    accounts = _ask("sacct", "--noheader", "--allocations", "--starttime=now")
    if accounts.returncode == 0:
        return "sacct", int(age[1])
    said = accounts.stderr.strip().splitlines()
    raise PandisError(
        f"nothing here tells Snakemake that a job has ended: squeue forgets a job {age[1]} s after "
        f"its end (MinJobAge in slurm.conf; {LONGEST_PAUSE} are needed), and the cluster keeps no "
        f"accounting database (sacct: {said[-1] if said else 'no answer'})"
    )


def listen(workflow):
    """Let Snakemake's Slurm plugin, if this run uses it, ask a command that will answer.

    The plugin asks `sacct` wherever that is installed. Without a database it never answers, and
    the run never ends.
    """
    plugin = workflow.executor_plugin
    if plugin is not None and plugin.name == "slurm":
        try:
            workflow.executor_settings.status_command, age = status_command()
        except PandisError as error:
            # Snakemake would print a traceback around it
            print(f"error: {error}", file=sys.stderr)
            raise SystemExit(1) from None
        # It asks for the age each time. While the controller is away it gets no answer, takes that
        # for a short memory, and turns to `sacct` for good.
        sys.modules["snakemake_executor_plugin_slurm"].get_min_job_age = lambda: age


def _ask(*command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))

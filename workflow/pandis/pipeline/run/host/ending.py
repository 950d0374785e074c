"""How a run ends: what it says, and the report of the meshes that are whole, if others failed."""

import json
import os
import subprocess
import sys
from pathlib import Path


def farewell(plan):
    """Return what a successful run prints at its end."""
    if plan.store:
        return f"\nThe results are in {_place(plan)}/"
    if plan.scenes:
        return f"\nThe scenes are in  {plan.folder}/scenes/"
    if not Path(plan.report).is_file() or Path(plan.report).stat().st_mtime < plan.start:
        return "Done. The report is made by the targets all and report."
    return (
        f"\nThe report is in   {plan.report}\n"
        f"The table is in    {plan.summary}\n"
        f"Exported fields:   {plan.folder}/{{mesh}}/export/"
    )


def condolence(plan):
    """Return what a failed run prints at its end."""
    return (
        "\nA job failed or was stopped; its message is above, after 'error:' or in a traceback.\n"
        f"All logs are in    {_place(plan)}/logs/\n"
        "Other meshes went on. Fix the cause and run the same command again: only what is "
        "missing or stale will run."
    )


def _place(plan):
    """Return where the results lie: a folder, or one in an object store."""
    return f"{plan.store.rstrip('/')}/{plan.folder}" if plan.store else plan.folder


def partial_note(plan):
    """Path of the list of meshes that the report leaves out; there while it does."""
    return Path(plan.folder) / "refused.json"


def forget_partial_report(plan):
    """See to it that a report that leaves meshes out is made anew, however it was copied."""
    if partial_note(plan).is_file():
        for path in (plan.report, plan.summary):
            if Path(path).is_file():
                os.utime(path, (1, 1))  # older than everything that it is made from


def partial_report(plan, workflow):
    """Write the report and the summary of the meshes that are whole, after a failed run.

    In a process of its own, for planning loads no numerics. What is written is no result of
    Snakemake's: it is older than all its inputs, and its records go.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        Whose run has failed; only if it would have made the report, nobody stopped it, and the
        results lie in files.
    """
    if plan.store:
        return
    final = [job for job in workflow.dag.jobs if {plan.report, plan.summary} & {*job.output}]
    if not any(plan.report in job.output for job in final):
        return
    facts = {"config": plan.config, "root": str(plan.digests.root), "files": plan.files}
    facts["since"] = plan.start
    command = [sys.executable, "-m", "pandis.pipeline.check.partial"]
    done = subprocess.run(
        command,
        input=json.dumps(facts, default=str),
        text=True,
        env=os.environ | {"PYTHONPATH": str(plan.digests.root)},
        check=False,
    )
    if done.returncode == 0:
        for output in (path for job in final for path in job.output):
            workflow.persistence.cleanup_metadata(output)
        forget_partial_report(plan)

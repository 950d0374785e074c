"""The end of a run: its last message, and a report of the complete meshes if others failed."""

import json
import os
import subprocess
import sys
from pathlib import Path

from pandis.base.children import python_path


def farewell(plan):
    """Return the last message of a successful run."""
    if plan.store:
        return f"\nThe results are in {_place(plan)}/"
    if plan.scenes:
        return f"\nThe scenes are in  {plan.folder}/scenes/"
    cards = "".join(f"\nThe card is in     {plan.folder}/datasets/{name}/card.html"
                    for name in plan.datasets.planned)  # fmt: skip
    if not plan.entries:
        return cards
    if not Path(plan.report).is_file() or Path(plan.report).stat().st_mtime < plan.start:
        return "Done. To make the report, run the target all or report."
    return (
        f"\nThe report is in   {plan.report}\n"
        f"The table is in    {plan.summary}\n"
        f"Exported fields:   {plan.folder}/{plan.meshes[0] if len(plan.meshes) == 1 else '{mesh}'}"
        f"/export/{cards}"
    )


def condolence(plan):
    """Return the last message of a failed run."""
    table = "\n".join(f"  {mesh:16} {stage:24} {why}" for mesh, stage, why in failures(plan))
    return (
        "\nA job failed or was stopped"
        + (
            f":\n{table}\nA traceback, if there is one, is above.\n"
            if table
            else "; its message or traceback is above.\n"
        )
        + f"All logs are in    {_place(plan)}/logs/\n"
        "Other meshes continued. Fix the cause and run the same command again: only missing or "
        "stale results will be made."
    )


def failures(plan):
    """Yield mesh, job and reason of each job of this run that ended with an error."""
    logs = Path(plan.folder, "logs")
    for path in sorted(logs.rglob("*.log")):
        if path.stat().st_mtime >= plan.start and (why := last_error(path)):
            where = path.relative_to(logs).with_suffix("").parts
            yield where[0] if len(where) > 1 else "-", where[-1], why


def last_error(path):
    """Return the error message at the end of a job's log; empty if there is none."""
    text = path.read_text(encoding="utf-8", errors="replace")
    _, mark, words = text.rpartition("] error: ")
    return words.strip() if mark else ""


def _place(plan):
    """Return the folder of the results, which may be in an object store."""
    return f"{plan.store.rstrip('/')}/{plan.folder}" if plan.store else plan.folder


def partial_note(plan):
    """Return the path of the list of meshes missing from the report; absent if none is missing."""
    return Path(plan.folder) / "refused.json"


def read_partial_note(plan):
    """Return why meshes are missing from the report, by name."""
    try:
        return json.loads(partial_note(plan).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def forget_partial_report(plan):
    """Make sure that an incomplete report is rebuilt, even if copying changed its time stamp."""
    if partial_note(plan).is_file():
        for path in (plan.report, plan.summary):
            if Path(path).is_file():
                os.utime(path, (1, 1))  # older than all its inputs


def partial_report(plan, workflow):
    """After a failed run, write a report and a summary of the meshes that are complete.

    A separate process writes them, because the planning process loads no numerical libraries. The
    files are dated before all their inputs, and Snakemake's records of them are deleted, so that
    the next run rebuilds them.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        The workflow whose run failed. Nothing is written if the run was not meant to make the
        report, if the user stopped it, or if the results are in an object store.
    """
    if plan.store:
        return
    final = [job for job in workflow.dag.jobs if {plan.report, plan.summary} & {*job.output}]
    if not any(plan.report in job.output for job in final):
        return
    facts = {"config": plan.config, "root": str(plan.digests.folder), "files": plan.files}
    facts["since"] = plan.start
    command = [sys.executable, "-m", "pandis.pipeline.check.partial"]
    done = subprocess.run(
        command,
        input=json.dumps(facts, default=str),
        text=True,
        env=os.environ | {"PYTHONPATH": python_path(plan.digests.root)},
        check=False,
    )
    if done.returncode == 0:
        for output in (path for job in final for path in job.output):
            workflow.persistence.cleanup_metadata(output)
        forget_partial_report(plan)

"""Writes a partial report and summary after a run in which some meshes failed.

It runs as ``python -m pandis.pipeline.check.partial``, with the plan on stdin. It is a separate
process, because the planning process, which detects the failure, loads no numerical libraries.
"""

import json
import sys
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.base.files import write_atomically
from pandis.engine.threads import thread_count
from pandis.pipeline.check.verification import Checker
from pandis.pipeline.report import collection
from pandis.pipeline.report.page import build, mesh_sections
from pandis.pipeline.report.seal import seal
from pandis.pipeline.report.tables import summarise, to_csv
from pandis.pipeline.run.host.ending import last_error, partial_note
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.pipeline.run.job.stage import INTERRUPTED, silent_progress
from pandis.pipeline.run.plan.plan import Plan

#: Artifacts that the summary needs for every mesh.
_STEMS = ("evaluation", "timing", "stress", "hardware")


def write_partial(plan):
    """Write a plan's report and summary, restricted to the meshes whose results are valid.

    Parameters
    ----------
    plan : pandis.pipeline.run.plan.plan.Plan

    Returns
    -------
    dict of str to str
        Reason for each mesh left out, by name. If no mesh is left out, or if all are, nothing is
        written.
    """
    checker, good, refused = Checker(plan), [], dict(plan.refused)
    for mesh in plan.meshes:
        paths = [Path(path) for path in plan.report_artifacts(mesh)]
        faults = [checker.fault(o) for o in plan.outputs(mesh) if Path(o.path) in paths]
        if any(faults):
            refused[mesh] = (
                last_words(plan, mesh) or f"its results are not valid: {next(filter(None, faults))}"
            )
        else:
            good.append(mesh)
    if not good or not refused:
        return refused
    table, page = (_collection if plan.until else _report)(plan, good, refused)
    why = {"stage": "partial", "wildcards": {}, "options": {"refused": refused}}
    # write the note first: while it exists, the other two files do not count as results
    write_atomically(partial_note(plan), (json.dumps(refused, indent=2) + "\n").encode())
    write_atomically(plan.summary, table.encode())
    write_atomically(plan.report, seal(page.encode(), why, ".html"))
    return refused


def _report(plan, good, refused):
    """Return the summary and the report of the ``good`` meshes, as text."""
    fields = {mesh: plan.entries[mesh].fields for mesh in good}
    meshes = {mesh: (plan.report_artifacts(mesh), fields[mesh]) for mesh in good}
    sections = mesh_sections(meshes, 1, silent_progress, note=_forget)
    columns = ([read_artifact(f"{plan.folder}/{mesh}/{stem}.zarr.zip") for mesh in good]
               for stem in _STEMS)  # fmt: skip
    return to_csv(summarise(columns), refused), build(sections, refused)


def _collection(plan, good, refused):
    """Return the table and the page of the ``good`` meshes' collection, as text."""
    meshes = {mesh: plan.report_artifacts(mesh) for mesh in good}
    rows = collection.collect(meshes, thread_count(), silent_progress, note=_forget)
    return collection.to_csv(rows, refused), collection.build(rows, refused)


def _forget(path, digest):
    """Ignore an input, because a partial report records no inputs."""


def was_stopped(plan, since):
    """Return whether the user stopped a job of the run that began at time ``since``."""
    logs = Path(plan.folder, "logs").rglob("*.log")
    return any(
        INTERRUPTED in path.read_text(encoding="utf-8", errors="replace")
        for path in logs
        if path.stat().st_mtime >= since
    )


def last_words(plan, mesh):
    """Return the error message of a mesh's last failed job, or an empty string."""
    logs = sorted(
        Path(plan.folder, "logs", mesh).glob("*.log"), key=lambda path: path.stat().st_mtime
    )
    return next(filter(None, map(last_error, reversed(logs))), "")


def main():
    """Read the plan from stdin and write the partial report."""
    plan_facts = json.loads(sys.stdin.read())
    try:
        plan = Plan(plan_facts["config"], plan_facts["root"], plan_facts["files"])
        if was_stopped(plan, plan_facts["since"]):
            return 1
        refused = write_partial(plan)
    except PandisError as error:
        print(f"error: cannot report on the other meshes: {error}", file=sys.stderr)
        return 1
    count = len(plan.meshes) + len(plan.refused) - len(refused)
    if not count or not refused:
        return 1
    print(
        f"{plan.report} and {plan.summary} cover the meshes that could be built ({count}) "
        f"and give reasons for those left out: {', '.join(refused)}",
        file=sys.stderr,
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

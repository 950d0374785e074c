"""Opens the plan for the Snakefile, and prints what is wrong with a configuration."""

import sys
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.pipeline.run.host.ending import forget_partial_report
from pandis.pipeline.run.plan.plan import Plan

#: Snakemake's records about the results of this working directory.
RECORDS = Path(".snakemake/metadata")
UNKNOWN = (
    "note: this folder has no record of the options behind the results in {}; the results are "
    "used as they are (see docs/cluster.md)"
)


def open_plan(config, folder, files, *, store, aloud=True):
    """Return the plan, or print the configuration's faults and end the process.

    With ``aloud``, print which meshes are refused, and why; the other meshes run anyway.
    """
    try:
        plan = Plan(config, folder, files, store=store)
    except PandisError as error:
        # Snakemake would print its own traceback around the message
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    if aloud:
        for mesh, why in plan.refused.items():
            print(f"refused: {mesh}: {why}", file=sys.stderr)
        forget_partial_report(plan)
        if plan.store and not (RECORDS.is_dir() and any(RECORDS.iterdir())):
            print(UNKNOWN.format(plan.store), file=sys.stderr)
    return plan

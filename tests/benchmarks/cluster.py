"""A configuration on this machine and on a Slurm cluster of one node, this machine, in turns.

Usage: .venv/bin/python tests/benchmarks/cluster.py FOLDER [CONFIG]

Runs CONFIG (config/config.yaml) twice in copies of the workflow below FOLDER: with `-j2`, and with
the profile for Slurm on the cluster of tests/cluster/node.py. Printed are both times, the jobs of
Slurm, the results whose bytes differ, and docs/figures/cluster.csv gets for each rule what it asks
for and the most that it has used.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common import ROOT, write

sys.path.insert(0, str(ROOT / "tests/helpers"))
sys.path.insert(0, str(ROOT / "tests/cluster"))

from node import Cluster
from small import differing, results

from support import copy_workflow

COLUMNS = ("rule", "jobs", "threads", "mem_mb", "max_mb", "runtime_min", "max_s")
PROFILE = ("--profile", "workflow/profiles/slurm")


def timed(folder, *arguments, **extra):
    """Return the seconds of a run."""
    start = time.monotonic()
    command = [sys.executable, "-m", "snakemake", *arguments]
    with (folder / "log").open("w") as log:
        done = subprocess.run(command, cwd=folder, stdout=log, stderr=log, check=False, **extra)
    if done.returncode:
        raise SystemExit(f"failed: {folder / 'log'}")
    return time.monotonic() - start


def used(folder):
    """Return a row for each rule: what it asks for, and the most that it has used."""
    rules = {}
    for path in (folder / "results/benchmarks").rglob("*.jsonl"):
        record = json.loads(path.read_text())
        rules.setdefault(record["rule_name"], []).append(record)
    return [
        {
            "rule": rule, "jobs": len(records), "threads": records[0]["threads"],
            "mem_mb": records[0]["resources"]["mem_mb"],
            "max_mb": max(float(record["max_rss"]) for record in records),
            "runtime_min": records[0]["resources"]["runtime"],
            "max_s": max(record["s"] for record in records),
        }
        for rule, records in sorted(rules.items())
    ]  # fmt: skip


def main(folder, config="config/config.yaml"):
    folder, asked = Path(folder), ("--configfile", config)
    here, there = (copy_workflow(ROOT, folder / name) for name in ("here", "there"))
    local = timed(here, "-j2", *asked, "--", "all")
    print(f"here: {local:.0f} s", flush=True)
    with tempfile.TemporaryDirectory(prefix="slurm") as at, Cluster(at, database=True) as cluster:
        slurm = timed(there, *PROFILE, *asked, "--", "all", env=cluster.environment)
        listed = "--allocations", "--noheader", "--starttime=now-1days"
        jobs = len(cluster.ask("sacct", *listed).splitlines())
    print(f"Slurm: {slurm:.0f} s, {jobs} jobs; overhead {100 * (slurm - local) / slurm:.0f} %")
    differ = differing(here, there)
    print(f"{len(results(here))} results, of which differ: {differ}")
    write("cluster", COLUMNS, used(there))
    shutil.rmtree(folder)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Repair every mesh of a folder; write docs/figures/repair.csv, from which docs/repair.md is made.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/repair.py [PATTERN…]
With patterns it prints the rows of the files that match and writes nothing.
A file that is refused with an option that would change the decision is run
again with that option. Each file runs in a process of its own.
"""

import csv
import json
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "workflow"))

from pandis.base.errors import PandisError  # noqa: E402
from pandis.pipeline.mesh.build import build  # noqa: E402
from pandis.pipeline.run.ask.tasks import MeshTask  # noqa: E402
from pandis.pipeline.run.job.machine import describe  # noqa: E402

COLUMNS = (
    "folder",
    "file",
    "outcome",
    "option",
    "rungs",
    "faces_before",
    "faces_after",
    "faults_before",
    "to_result_p99_percent",
    "to_result_max_percent",
    "to_source_p99_percent",
    "to_source_max_percent",
    "caps_percent",
    "hidden_percent",
    "untouched_percent",
    "seconds",
    "memory_mb",
    "message",
)
SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".3mf")


def measure(path, option):
    """Repair one file in this process and print its row as JSON."""
    task = MeshTask(**option, source=str(path), sha256=None, seed=0)
    row, start = {}, time.perf_counter()
    try:
        arrays, found = build(task, path, lambda text: print(f"  {text}", file=sys.stderr))
        moved, before, after = found["deviation"], found["before"], found["after"]
        percent = 100 / after["diagonal"]
        row = {
            "outcome": "valid" if after["valid"] else "INVALID",
            "rungs": " ".join(r["operation"] for r in found["rungs"] if r["kept"]) or "none",
            "faces_before": before["faces"],
            "faces_after": len(arrays["faces"]),
            "faults_before": found["faults_before"],
            "caps_percent": 100 * moved["to_source"]["caps"],
            "hidden_percent": 100 * moved["to_result"]["hidden"],
            "untouched_percent": 100 * moved["untouched"],
        }
        for way in ("to_result", "to_source"):
            for key in ("p99", "max"):
                row[f"{way}_{key}_percent"] = percent * moved[way][key]
    except PandisError as error:
        row = {"outcome": "refused", "message": str(error)}
    row["seconds"] = time.perf_counter() - start
    usage = [resource.getrusage(who).ru_maxrss for who in (0, resource.RUSAGE_CHILDREN)]
    row["memory_mb"] = max(usage) / 1024
    print(json.dumps(row))


def run(path, option):
    """Measure in a child process."""
    command = [sys.executable, __file__, "--one", str(path), json.dumps(option)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        return {"outcome": "CRASHED", "message": f"exit {done.returncode}"}
    return json.loads(done.stdout)


def main(patterns):
    """Run every file; print and write the rows."""
    folder = Path(os.environ["PANDIS_MESHES"])
    rows = []
    for path in sorted(folder.glob("*/*")):
        if path.suffix not in SUFFIXES or (patterns and not any(p in path.name for p in patterns)):
            continue
        print(path.name, file=sys.stderr)
        row, option = run(path, {}), {}
        # the first message says why; a second one may name another value of the same option
        for _ in range(2):
            advice = re.search(r"`mesh: \{(\w+): (\w+)\}`", row.get("message", ""))
            if row["outcome"].startswith("refused") and advice:
                option = {advice[1]: advice[2]}
                again = run(path, option)
                again["outcome"] += " with option"
                row = row | again
        row |= {"folder": path.parent.name, "file": path.name}
        row["option"] = " ".join(f"mesh.{key}: {value}" for key, value in option.items())
        row["message"] = " ".join(row.get("message", "").split())
        rows.append({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
        print("  ->", {k: v for k, v in rows[-1].items() if v != ""}, file=sys.stderr, flush=True)
    if patterns:
        return
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    machine = describe()
    target = ROOT / "docs" / "figures" / "repair.csv"
    with target.open("w", encoding="utf-8", newline="") as stream:
        stream.write("# command: .venv/bin/python tests/benchmarks/repair.py\n")
        stream.write(f"# machine: {machine['processor']}, {machine['cores']} cores, shared\n")
        stream.write(f"# commit: {commit}\n")
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n", restval="")
        writer.writeheader()
        writer.writerows(rows)
    print(f"wrote {target}", file=sys.stderr)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]), json.loads(sys.argv[3]))
    else:
        main(sys.argv[1:])

"""The error-against-time front of three scans and three CAD or thin meshes; docs/figures/front.csv.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/front.py

In an empty folder of its own, config/front.yaml with those meshes, and with networks that train in
half a minute to a minute each. The networks come first; the minutes of each part are written down.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from common import ROOT, SCANS, notes

MESHES = SCANS | {
    "fandisk": "watertight/fandisk_6475v_12946f.obj",
    "rockerarm": "watertight/rockerarm_10044v_20088f.obj",
    "sword": "watertight/sword_22293v_44582f.obj",
}
STEPS = {
    "pandis": 1500, "pandis-exact-32": 600, "pandis-exact-64": 600, "pandis-exact-128": 600,
    "pandis-exact": 800,
}  # fmt: skip
CONFIG = "config/front6.yaml"


def prepare(folder):
    """Copy the workflow, and write its configuration."""
    for part in ("config", "rules", "scripts", "workflow"):
        shutil.copytree(ROOT / part, folder / part)
    config = yaml.safe_load((ROOT / "config/front.yaml").read_text(encoding="utf-8"))
    for recipe, steps in STEPS.items():
        config["train"][recipe] = config["train"].get(recipe, {}) | {"steps": steps}
    source = Path(os.environ["PANDIS_MESHES"])
    config["meshes"] = {name: {"source": str(source / path)} for name, path in MESHES.items()}
    (folder / CONFIG).write_text(yaml.safe_dump(config), encoding="utf-8")


def run(folder, target):
    """Run the workflow up to a target; return the minutes that it took."""
    start = time.monotonic()
    command = [ROOT / ".venv/bin/snakemake", "-j2", target, "--configfile", CONFIG]
    subprocess.run(command, cwd=folder, check=True)
    return (time.monotonic() - start) / 60


def main():
    """Run, and write the table."""
    folder = Path(tempfile.mkdtemp(prefix="front-"))
    prepare(folder)
    minutes = {target: run(folder, target) for target in ("models", "evaluations", "all")}
    print(folder, minutes, file=sys.stderr)
    collect(folder, minutes)


def collect(folder, minutes):
    """Write the table from a finished run, with the minutes that its parts took."""
    text = (folder / "results/summary.csv").read_text(encoding="utf-8")
    names = {
        "models": "networks",
        "evaluations": "the rest of the front",
        "all": "hardware, report",
    }
    took = ", ".join(f"{names[key]} {value:.1f}" for key, value in minutes.items())
    head = f"{notes('front.py')}# minutes: {took}\n"
    (ROOT / "docs/figures/front.csv").write_text(head + text, encoding="utf-8")


if __name__ == "__main__":
    main()

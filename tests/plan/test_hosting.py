"""What hosts of a repository read: the GitHub workflow and the entry for the workflow catalog."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import yaml

from support import ROOT, environment


def test_the_github_workflow_runs_what_ci_runs():
    """Its steps fetch the repository and a Python, and call one script, which CI calls, too."""
    text = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    (job,) = yaml.safe_load(text)["jobs"].values()
    fetch, python, run = job["steps"]
    assert fetch["uses"].startswith("actions/checkout@")
    assert python["uses"].startswith("actions/setup-python@")
    assert run == {"run": ".ci/run"}
    assert os.access(ROOT / ".ci/run", os.X_OK)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["requires-python"] == f">={python['with']['python-version']}"


def test_the_catalog_finds_what_its_entry_promises():
    """It lints the workflow with its default configuration, and lists what a user has to set."""
    entry = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text(encoding="utf-8"))
    assert entry["usage"]["software-stack-deployment"] == {"conda": True}
    assert all(rule.is_file() for rule in (ROOT / "workflow/Snakefile", ROOT / "config/README.md"))
    assert list((ROOT / "workflow/envs").glob("*.yaml"))
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--lint"], cwd=ROOT, env=environment(),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_hooks_of_a_commit_run_what_lint_runs():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    lint = (ROOT / "Makefile").read_text(encoding="utf-8")
    for hook in hooks:
        tool, *words = hook["entry"].split()
        assert f"$(BIN)/{Path(tool).name} {words[0]}" in lint

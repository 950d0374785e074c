"""A kind of field is one folder: docs/kinds.md is carried out, word by word."""

import csv
import json
import re

import numpy as np
import pytest
import trimesh
import yaml

import pandis
from support import ROOT, edit, snakemake

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

PAGE = ROOT / "docs/kinds.md"
CONFIG = "config/ball.yaml"


def follow(folder):
    """Do in a copy of the workflow what the page says."""
    text = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"^`([\w/.]+)`\n\n```(\w+)\n(.*?)^```", text, re.M | re.S)
    for name, kind, block in blocks:
        path = folder / name
        if kind == "diff":
            old, new = (re.search(rf"^\{sign}(.*)$", block, re.M)[1] for sign in "-+")
            edit(path, old, new)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(block)
    return [name for name, _, _ in blocks]


def test_the_recipe_adds_a_kind_that_goes_all_the_way(workspace):
    written = follow(workspace)
    assert len(written) == 6
    config = yaml.safe_load((workspace / "config/fast.yaml").read_text())
    config |= {"fields": ["exact", "ball"], "meshes": {"sphere": {"source": "analytic:sphere"}}}
    (workspace / CONFIG).write_text(yaml.safe_dump(config))
    for target in ("all", "verify"):
        run = snakemake(workspace, "-j2", target, "--configfile", CONFIG)
        assert run.returncode == 0, run.stdout
    home = workspace / "results"
    with (home / "summary.csv").open() as stream:
        rows = {row["field"]: row for row in csv.DictReader(stream)}
    assert float(rows["ball"]["trajectory_mean"]) < 1e-6
    assert "ball" in (home / "report.html").read_text()
    hardware = json.loads((home / "sphere/hardware.json").read_text())
    assert "ball" in hardware["fields"]
    with pandis.load(home / "sphere/export/ball.pandis") as field:
        assert field.query(np.array([[0.0, 0.0, 0.5]])).distance == pytest.approx([-0.5])
    # a closed form lies around the origin of the mesh's coordinates, wherever the object is
    trimesh.creation.icosphere(radius=1).apply_translation([3, 0, 0]).export(workspace / "far.stl")
    config |= {"meshes": {"far": {"source": "far.stl"}}, "results": "results/far"}
    (workspace / "config/far.yaml").write_text(yaml.safe_dump(config))
    run = snakemake(workspace, "-j2", "exports", "--configfile", "config/far.yaml")
    assert run.returncode == 0, run.stdout
    with pandis.load(home / "far/far/export/ball.pandis") as field:
        assert field.query(np.array([[0.0, 0.0, 5.0]])).distance == pytest.approx(
            [5 - 28 / 9], abs=0.02
        )
    # another kind's results do not depend on it
    edit(workspace / "workflow/pandis/pipeline/kinds/ball/build.py", ".mean(", ".max(")
    again = snakemake(workspace, "-n", "all", "--configfile", CONFIG).stdout
    jobs = dict(re.findall(r"^(\w+) +(\d+)$", again, re.M))
    assert jobs["bake"] == "1", again
    assert "mesh" not in jobs

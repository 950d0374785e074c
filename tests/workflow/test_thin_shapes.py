"""Whole runs on thin shapes: each ends with a report that no hole in a field fools."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from pandis.pipeline.geometry.shares import MISSING_LIMIT
from pandis.pipeline.judge.errors.front import may_be_used
from pandis.pipeline.run.job.artifact import read_artifact
from shapes import MADE
from support import snakemake, write_obj

pytestmark = pytest.mark.full

CONTROLS = {"control-zero", "control-gap", "control-thin"}
CONFIG = {
    "fields": ["exact", "trilinear-24", "spline-auto", "pandis-exact"],
    "bake": {"auto": {"spline": {"bytes": 400_000}}},
    "train": {"pandis-exact": {"width": 64, "depth": 3, "omega": 15, "steps": 1000, "batch": 2048}},
    "evaluation": {"probes": 5000},
    "stress": {"ticks": 20_000, "loops": 4},
    "timing": {"queries": 500, "cold": 3},
    "hardware": {"seconds": 0.5, "loaded_seconds": 0},
}


def sources(folder):
    """Write the generated shapes; return the sources of all, with the real sword where it is."""
    found = {}
    for own, make in MADE.items():
        mesh, name = make(), own.replace(".", "-")
        path = write_obj(folder / f"{name}.obj", np.asarray(mesh.vertices), mesh.faces)
        found[name] = {"source": str(path.relative_to(folder))}
    meshes = os.environ.get("PANDIS_MESHES")
    for path in sorted(Path(meshes).rglob("sword_*.obj")) if meshes else ():
        found["sword"] = {"source": str(path)}
    return found


def test_every_run_ends_with_a_report_that_recommends_nothing_with_a_hole(workspace):
    config = CONFIG | {"meshes": sources(workspace)}
    (workspace / "config/thin.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
    done = snakemake(workspace, "-j2", "all", "--configfile", "config/thin.yaml")
    assert done.returncode == 0, done.stdout
    assert (workspace / "results/report.html").stat().st_size > 100_000
    table = (workspace / "results/summary.csv").read_text().splitlines()
    rows = list(csv.DictReader(table))
    for mesh in config["meshes"]:
        home = workspace / "results" / mesh
        stress = read_artifact(home / "stress.zarr.zip").attributes
        assert set(stress["controls"]) == CONTROLS
        assert all(stress["controls"].values())  # each failed something
        assert set(read_artifact(home / "evaluation.zarr.zip").attributes["controls"]) == CONTROLS
        for row in rows:
            if row["mesh"] != mesh or row["stress"] == "":
                continue
            asked = ("stress", "missing_percent", "left_out_percent")
            own = {key: float(row[key]) for key in asked}
            assert own["stress"] == len(stress["failed"][row["field"]])
            if row["field"] == "exact":  # of a blade, too much is too thin to be judged
                thin = own["left_out_percent"] > 100 * MISSING_LIMIT
                assert stress["failed"]["exact"] == ["missing"] * thin
                assert may_be_used(own) != thin
                assert thin == (mesh in ("blade", "sword"))
            if own["missing_percent"] > 0.5:
                assert "missing" in stress["failed"][row["field"]]
        followed = read_artifact(home / "trajectory.zarr.zip").attributes["followed"]
        assert followed or not mesh.startswith("plate")
    check = snakemake(workspace, "verify", "--configfile", "config/thin.yaml", "-j1")
    assert check.returncode == 0, check.stdout

"""The workflow as a module of another one, in a repository of its own."""

import subprocess

import pytest
import yaml

from pandis.runtime.field import NativeField
from support import ROOT, copy_workflow, snakemake

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

SNAKEFILE = """
configfile: "settings.yaml"


module pandis:
    snakefile:
        {snakefile}
    config:
        config["fields"]


use rule * from pandis as pandis_*


rule lookup:
    input:
        "made/ball/export/trilinear-16.pandis",
    output:
        "bytes.txt",
    shell:
        "wc -c < {{input}} > {{output}}"
"""
SETTINGS = {
    "fields": {
        "results": "made",
        "meshes": {"ball": {"source": "analytic:sphere"}},
        "fields": ["exact", "trilinear-16"],
    }
}
PROFILE = ("--workflow-profile", "pandis/workflow/profiles/default")


def git(folder, *arguments):
    command = ["git", "-c", "user.name=t", "-c", "user.email=t@example.org", *arguments]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


def repository(folder, snakefile):
    """Make a repository whose workflow takes in another one's."""
    folder.mkdir()
    git(folder, "init")
    (folder / "Snakefile").write_text(SNAKEFILE.format(snakefile=snakefile))
    (folder / "settings.yaml").write_text(yaml.safe_dump(SETTINGS))
    return folder


def test_another_repository_takes_the_workflow_in(tmp_path):
    folder = repository(tmp_path / "robot", '"pandis/workflow/Snakefile"')
    copy_workflow(ROOT, folder / "pandis")
    git(folder, "add", ".")
    git(folder, "commit", "-m", "A workflow that needs fields")
    done = snakemake(folder, "-j2", *PROFILE, "lookup", "pandis_exports")
    assert done.returncode == 0, done.stdout
    made = folder / "made" / "ball" / "export"
    assert {path.name for path in made.iterdir()} == {
        "exact.pandis", "trilinear-16.pandis", "trilinear-16.onnx"
    }  # fmt: skip
    size = (made / "trilinear-16.pandis").stat().st_size
    assert int((folder / "bytes.txt").read_text()) == size
    assert NativeField(made / "exact.pandis").query([[0.0, 0.0, 0.5]]).distance == [-0.5]
    # what was made is current, whatever the rules are called; an option makes what it must stale
    again = snakemake(folder, "-n", *PROFILE, "lookup", "pandis_exports")
    assert "Nothing to be done" in again.stdout
    wider = yaml.safe_load((folder / "settings.yaml").read_text())
    wider["fields"]["bake"] = {"inside": 0.2}
    (folder / "settings.yaml").write_text(yaml.safe_dump(wider))
    stale = snakemake(folder, "-n", "--quiet", "rules", *PROFILE, "pandis_exports").stdout
    jobs = {line.split()[0] for line in stale.splitlines() if line.startswith("pandis_")}
    assert {"pandis_bake", "pandis_export_native"} <= jobs
    assert "pandis_mesh" not in jobs


def test_a_snakefile_without_its_library_says_what_to_do(tmp_path):
    copy_workflow(ROOT, tmp_path / "source")
    git(tmp_path / "source", "init")
    git(tmp_path / "source", "add", ".")
    git(tmp_path / "source", "commit", "-m", "The workflow")
    fetched = f'gitfile("{tmp_path}/source", path="workflow/Snakefile", ref="HEAD")'
    folder = repository(tmp_path / "robot", fetched)
    done = snakemake(folder, "-n", "pandis_exports")
    assert done.returncode == 1
    assert "git submodule add" in done.stdout

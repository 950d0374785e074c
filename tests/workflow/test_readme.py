"""What the README tells a newcomer to do: a force from a mesh in a loop, in C++ and Python."""

import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from support import ROOT, environment, snakemake

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

#: Where a release is tried: its own Python, and the folder of its header (docs/tools/release.py).
PYTHON, HEADER = os.environ.get("PANDIS_PYTHON"), os.environ.get("PANDIS_HEADER")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language):
    """Return the README's only block in a language."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", README, re.M | re.S)
    assert len(found) == 1, f"{len(found)} blocks in {language}"
    return found[0]


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_a_force_in_a_program_of_ones_own(workspace):
    box = trimesh.creation.box((30, 20, 12))  # millimetres
    box.apply_translation([2, 3, 4])
    box.export(workspace / "part.stl")
    (workspace / "my.yaml").write_text(block("yaml"))
    command = re.search(r"`snakemake (-j2 exports [^`]*)`", README)[1]
    done = snakemake(workspace, *command.split())
    assert done.returncode == 0, done.stdout

    (workspace / "loop.cpp").write_text(block("cpp"))
    compiled, run = re.search(r"^(g\+\+ .*) && (\./loop)$", README, re.M).groups()
    include = HEADER or "workflow/pandis/engine"
    compiled = compiled.replace("workflow/pandis/engine", include)
    subprocess.run(compiled.split(), cwd=workspace, check=True)
    said = subprocess.run([run], cwd=workspace, capture_output=True, text=True, check=True).stdout
    # a millimetre below the surface, whichever wall the middle of the box is led to
    force = np.array(said.split()[:3], float)
    assert np.linalg.norm(force) == pytest.approx(1 * 0.4, abs=0.02)
    (workspace / "results/my/part/export/compact-auto.pandis").rename(workspace / "away.pandis")
    lost = subprocess.run([run], cwd=workspace, capture_output=True, text=True, check=False)
    assert (lost.returncode, lost.stdout) == (1, "the file cannot be read\n")
    (workspace / "away.pandis").rename(workspace / "results/my/part/export/compact-auto.pandis")

    python = PYTHON or sys.executable
    outside = environment(**({} if PYTHON else {"PYTHONPATH": str(workspace / "workflow")}))
    program = block("python") + "print(*force[0])\n"
    done = subprocess.run(
        [python, "-c", program], cwd=workspace, env=outside, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    file = re.search(r"python -m pandis view (\S+)", README)[1]
    page = workspace / "touch.html"
    subprocess.run(
        [python, "-m", "pandis", "view", file, "--output", str(page)],
        cwd=workspace, env=outside, check=True,
    )  # fmt: skip
    assert "compact-auto" in page.read_text(encoding="utf-8")
    # (1, 2, 3) lies an edge's length of five below the lower wall, at -2
    assert np.array(done.stdout.split(), float) == pytest.approx([0, 0, -5 * 0.4], abs=0.02)


def test_the_links_of_the_docs_lead_somewhere():
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config/README.md",
                 *(ROOT / "docs").rglob("*.md")]:  # fmt: skip
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)\s]*)?\)", text):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"

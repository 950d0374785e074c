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


def typed(workspace, command):
    """Carry out a line of the README as a shell would; return what it prints."""
    python = PYTHON or sys.executable
    outside = environment(**({} if PYTHON else {"PYTHONPATH": str(workspace / "workflow")}))
    command = command.replace("pandis ", f"{python} -m pandis ", 1)
    done = subprocess.run(command, shell=True, cwd=workspace, env=outside, capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def commands():
    """Return the lines of the README's first block that call pandis, without comments."""
    lines = re.search(r"^```sh\n(.*?)^```$", README, re.M | re.S)[1].splitlines()
    return [re.sub(r" +#.*", "", line) for line in lines if line.startswith("pandis ")]


@pytest.fixture
def part(workspace):
    """A workspace with part.stl: a box of millimetres from (-13, -7, -2) to (17, 13, 10)."""
    box = trimesh.creation.box((30, 20, 12))
    box.apply_translation([2, 3, 4])
    box.export(workspace / "part.stl")
    return workspace


#: The release is tried with the wheel's packages for meshes, and here with all.
def test_commands_on_one_mesh(part):
    check, field, compare, labels, view = commands()
    assert "valid; 12 faces" in typed(part, check)
    typed(part, field)
    assert "fit for use" in typed(part, compare)
    typed(part, labels)
    with np.load(part / "part.npz") as stored:
        inside = stored["distance"] < 0
        middle = np.abs(stored["points"] - (2, 3, 4)) < (15, 10, 6)
        assert (inside == middle.all(axis=1))[stored["stratum"] > 0].all()
        assert 10_000 < inside.sum() < 300_000
    typed(part, f"{view} --output touch.html")
    assert "part" in (part / "touch.html").read_text(encoding="utf-8")


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_a_force_in_a_program_of_ones_own(part):
    typed(part, commands()[1])
    (part / "loop.cpp").write_text(block("cpp"))
    compiled, run = re.search(r"^(g\+\+ .*) && (\./loop)$", README, re.M).groups()
    include = HEADER or typed(part, "pandis include").strip()
    compiled = compiled.replace("$(pandis include)", include).replace('"', "")
    subprocess.run(compiled.split(), cwd=part, check=True)
    said = subprocess.run([run], cwd=part, capture_output=True, text=True, check=True).stdout
    # a tenth of a millimetre below the surface, whichever wall the middle of the box is led to
    force = np.array(said.split()[:3], float)
    assert np.linalg.norm(force) == pytest.approx(0.1 * 0.4, abs=0.002)
    (part / "part.pandis").rename(part / "away.pandis")
    lost = subprocess.run([run], cwd=part, capture_output=True, text=True, check=False)
    assert (lost.returncode, lost.stdout) == (1, "the file is missing or cannot be read\n")


def test_a_force_in_python(part):
    (part / "program.py").write_text(block("python") + "print(*force[0])\n")
    said = typed(part, f"{PYTHON or sys.executable} program.py")
    # (1, 2, 3) lies an edge's length of five below the lower wall, at -2
    assert np.array(said.split(), float) == pytest.approx([0, 0, -5 * 0.4], abs=0.02)


@pytest.mark.skipif(PYTHON is not None, reason="a release is tried without Snakemake")
def test_the_workflow_on_ones_own_mesh(part):
    (part / "my.yaml").write_text(block("yaml"))
    command, exported = re.search(
        r"`snakemake (-j2 exports [^`]*)` stops at `([^`]*)`", README
    ).groups()
    done = snakemake(part, *command.split())
    assert done.returncode == 0, done.stdout
    exported = sorted(part.glob(exported))
    assert [path.stem for path in exported] == ["compact-auto", "exact"]
    typed(part, "pandis field part.stl --size '60 mm'")
    assert (part / "part.pandis").read_bytes() == exported[0].read_bytes()


def test_the_links_of_the_docs_lead_somewhere():
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config/README.md",
                 *(ROOT / "docs").rglob("*.md")]:  # fmt: skip
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)\s]*)?\)", text):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"

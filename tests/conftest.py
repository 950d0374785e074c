"""Fixtures: a copy of the workflow to play with, and one that has run."""

import os
import re
import shutil
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

PACKAGE = Path(__file__).parents[1] / "workflow/pandis"
#: Imports a shape of arrays.
SHAPES = re.compile(r"^from pandis\.(base\.arrays|\S+\.training\.tensors) import", re.M)
#: What an array's shape may be stands in signatures: here every call of a module with such
#: signatures is checked. The check takes as long as a short function, so others go without it.
install_import_hook(
    [
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for path in PACKAGE.rglob("*.py")
        if SHAPES.search(path.read_text(encoding="utf-8"))
    ],
    "beartype.beartype",
)

import support  # noqa: E402

#: The longest tests of all, which begin before the others.
LONGEST = ("test_twelve_kinds", "test_every_kind_of_grid", "test_open_mesh_with_two_networks")


def pytest_addoption(parser):
    parser.addoption("--part", metavar="K/N", help="run every N-th test, from the K-th on")


def pytest_collection_modifyitems(config, items):
    """Take a part of the tests, and put long ones first: one at the end leaves a core idle."""
    if part := config.getoption("part"):
        if not (match := re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", part)) or int(match[1]) > int(
            match[2]
        ):
            raise pytest.UsageError(f"--part {part}: write K/N, K from 1 to N, as in 1/4")
        first, step = map(int, match.groups())
        chosen = set(sorted(item.nodeid for item in items)[first - 1 :: step])
        config.hook.pytest_deselected(items=[i for i in items if i.nodeid not in chosen])
        items[:] = [item for item in items if item.nodeid in chosen]

    def place(item):
        return not item.name.startswith(LONGEST), item.path.parent.name != "workflow"

    items.sort(key=place)


@pytest.fixture(autouse=True)
def _folder_restored():
    """A test that changes the working directory changes it back: later ones start from it."""
    here = os.getcwd()
    yield
    assert os.getcwd() == here, "the test has changed the working directory"


@pytest.fixture
def workspace(tmp_path):
    """A fresh copy of the workflow without results."""
    return support.copy_workflow(support.ROOT, tmp_path / "workflow-copy")


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A copy in which config/fast.yaml has run to its end. Never change it: copy it.

    No test asks how long its stages took, so each may run beside another.
    """
    one = [f"{rule}=1" for rule in ("bake", "evaluate", "stress", "timing", "validate")]

    def run(folder):
        support.copy_workflow(support.ROOT, folder)
        done = support.snakemake(
            folder, "-j2", "all", "--configfile", "config/fast.yaml", "--set-threads", *one
        )
        assert done.returncode == 0, done.stdout

    return support.once(tmp_path_factory, "finished", run)


@pytest.fixture
def rerun(finished, tmp_path):
    """A copy of the finished run, records of Snakemake included."""
    folder = tmp_path / "rerun"
    compiled = shutil.ignore_patterns("__pycache__")  # a quarter of the files, and not needed
    shutil.copytree(finished, folder, symlinks=True, ignore=compiled)
    return folder


@pytest.fixture
def meshes():
    """The folder of real meshes, where there is one."""
    folder = os.environ.get("PANDIS_MESHES")
    if not folder:
        pytest.skip("PANDIS_MESHES names no folder of real meshes")
    return Path(folder)

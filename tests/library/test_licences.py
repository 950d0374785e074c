"""No module imports what is under the GPL or the AGPL; the tools run in processes of their own."""

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from pandis.pipeline.mesh import tools
from support import ROOT, environment

FOREIGN = {"pymeshlab", "pymeshfix", "igl.copyleft"}
IMPORTS = """
import importlib, pkgutil, sys
import pandis
from pandis.base.errors import PandisError
names = [each.name for each in pkgutil.walk_packages(pandis.__path__, "pandis.")]
for name in names:
    try:
        importlib.import_module(name)
    except (ImportError, PandisError) as error:  # a bridge to what is not here
        assert name.startswith(("pandis.bridges.", "pandis.engine.cuda.")), (name, error)
print(len(names), *sys.modules)
"""


@pytest.mark.slow
def test_no_module_imports_what_is_under_the_gpl():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS], env=environment(PYTHONPATH=str(ROOT / "workflow")),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    count, *modules = done.stdout.split()
    assert int(count) > 200
    assert {"pandis.pipeline.mesh.tools", "igl", "trimesh"} <= set(modules)
    assert not FOREIGN & set(modules)


def test_compact_meshes_are_simplified_without_it(monkeypatch):
    """PyMeshLab did this, whatever the rungs were. The same mesh comes again, closed."""
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    ball = trimesh.creation.icosphere(4)
    one, other = (tools.simplify(ball.vertices, ball.faces, 500) for _ in range(2))
    assert all(np.array_equal(*pair) for pair in zip(one, other, strict=True))
    simple = trimesh.Trimesh(*one, process=False)
    assert len(simple.faces) == 500
    assert simple.is_watertight
    assert simple.volume == pytest.approx(ball.volume, rel=0.01)

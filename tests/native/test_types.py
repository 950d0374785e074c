"""What a type checker sees of the package: every answer has a type, and wrong use is told."""

import inspect
import os
import subprocess
import sys

import pytest

import pandis
from support import ROOT

pytest.importorskip("mypy", reason="no mypy here")

PROGRAM = """
import numpy as np
from numpy.typing import NDArray

import pandis
from pandis import Contact, Material, Placed, Poses, Scene, SharedField, Texture, TouchedScene

Floats = NDArray[np.float64]
field = pandis.load("bunny.pandis")
points = field.frame.to_mesh(np.zeros((3, 3)))
force: Floats = field.force([[0.0, 0.0, 0.0]], k=400)
distance, normal, flag = field.query(points)
first: Floats = distance
flags: NDArray[np.uint8] = flag
bent: Floats = field.hessian((0, 0, 0))
within: Floats = field.query_within(points, 0.1)[1]
names: tuple[str, ...] = field.region_names
taken: float = field.moving().refit(points)
placed = Placed.at(field, 0.1, 400.0, position=(0, 0, 1))
pushed: Floats = Contact(placed, material=Material(0.5, 0.4)).follow(points).force
scene = TouchedScene([placed], textures=[Texture.noise(1e-4, 1e-2)])
touched: NDArray[np.int32] = scene.touches([0, 0, 0])[0]
asked: NDArray[np.int64] = Scene([placed]).answer(points).queries
poses = Poses(scene)
poses.give([np.eye(3)], [[0, 0, 1]], [[0, 0, 0]], spins=[[0, 0, 0]], period=0.01)
moved: bool = poses.step(1e-3)
seconds: float = SharedField(field).refit(points)
"""
WRONG = {
    'field.force(points, k="stiff")': 'incompatible type "str"',
    "field.forces(points)": 'has no attribute "forces"',
    "number: int = field.query(points).distance": "Incompatible types in assignment",
    "Contact(field)": 'expected "Placed"',
    "pandis.Poses(placed)": 'expected "NativeScene"',
}


def checked(text, folder):
    """Return what mypy says of a program, line by line."""
    (folder / "program.py").write_text(text)
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "program.py"]
    environment = os.environ | {"MYPYPATH": str(ROOT / "workflow"), "MYPY_CACHE_DIR": ".cache"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode < 2, done.stdout + done.stderr
    return [line for line in done.stdout.splitlines() if "error:" in line]


@pytest.mark.slow
def test_a_type_checker_knows_the_answers_and_tells_wrong_use(tmp_path):
    """A program without a fault passes the strictest check, and each fault is found in its line."""
    assert (ROOT / "workflow/pandis/py.typed").exists()
    start = PROGRAM.count("\n") + 1
    found = checked(PROGRAM + "\n".join(WRONG) + "\n", tmp_path)
    lines = [int(line.split(":")[1]) for line in found]
    assert lines == [start + k for k in range(len(WRONG))], found
    for line, told in zip(found, WRONG.values(), strict=True):
        assert told in line


def functions_of(name):
    """Yield each function behind a public name: itself, or what a class offers."""
    value = getattr(pandis, name)
    for key in dir(value) if inspect.isclass(value) else ():
        member = inspect.getattr_static(value, key)
        member = getattr(member, "fget", None) or getattr(member, "__func__", member)
        ours = inspect.isfunction(member) and member.__module__.startswith("pandis")
        if ours and (not key.startswith("_") or key == "__init__"):
            yield key, member
    if inspect.isfunction(value):
        yield name, value


@pytest.mark.parametrize("name", pandis.__all__)
def test_everything_public_has_its_types(name):
    for key, function in functions_of(name):
        signature = inspect.signature(function)
        bare = [p.name for p in signature.parameters.values() if p.annotation is p.empty]
        assert not set(bare) - {"self", "cls"}, key
        assert key == "__init__" or signature.return_annotation is not signature.empty, key


def test_the_public_surface_is_listed_once():
    assert set(pandis.__all__) == {"load", "sample", *pandis._PLACES}
    assert set(pandis.__all__) <= set(dir(pandis))
    with pytest.raises(AttributeError, match="no attribute 'Feild'"):
        pandis.Feild  # noqa: B018

"""The house: floors import downwards only, and there are few rooms and few loose modules."""

import ast

import pytest
import yaml

from support import ROOT, edit

PACKAGE = ROOT / "workflow/pandis"
ROOMS, LOOSE, LINES = 12, 3, 400


def floors():
    return yaml.safe_load((ROOT / "docs/floors.yaml").read_text(encoding="utf-8"))


def floor_of(module, levels):
    """Return floor and room of a module: the longest name in the file that it begins with."""
    parts = module.split(".")[1:]
    for depth in range(len(parts), 0, -1):
        name = ".".join(parts[:depth])
        if name in levels:
            return levels[name], parts[0]
    raise AssertionError(f"docs/floors.yaml does not say where {module} stands")


def modules(package):
    """Yield the dotted name and the path of every module but the package's own."""
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        name = ".".join(("pandis", *(parts[:-1] if parts[-1] == "__init__" else parts)))
        if name != "pandis":
            yield name, path


def imports(path, known):
    """Return the modules of the package that a module imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: imports are absolute"
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in known else node.module for name in whole}
    return {name for name in found if name.startswith("pandis.")}


def faults(package):
    """Return every import that goes up, or sideways into another room."""
    levels = {name: level for level, floor in enumerate(floors()) for name in floor}
    known, wrong = dict(modules(package)), []
    for name, path in known.items():
        level, room = floor_of(name, levels)
        for other in imports(path, known):
            below, next_room = floor_of(other, levels)
            if below > level or (below == level and next_room != room):
                wrong.append(f"{name} imports {other}")
    return wrong


def test_modules_import_from_floors_below():
    assert faults(PACKAGE) == []


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("geometry/frame.py", "from pandis.native import bvh"),
        ("stress/work.py", "from pandis.export import check"),
        ("run/plan.py", "import pandis.report.page"),
        ("mesh/repair.py", "def f():\n    from pandis.grids.axes import Axes"),
    ],
)
def test_an_import_that_goes_up_or_sideways_is_found(path, line, workspace):
    package = workspace / "workflow/pandis"
    text = (package / path).read_text()
    edit(package / path, text, f"{text}\n\n{line}\n")
    assert len(faults(package)) == 1


def test_every_place_in_the_file_exists():
    known = dict(modules(PACKAGE))
    for floor in floors():
        for name, purpose in floor.items():
            assert f"pandis.{name}" in known
            assert purpose


def test_there_are_few_rooms_and_few_loose_modules():
    rooms = [path for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()]
    loose = [path for path in PACKAGE.glob("*.py") if not path.name.startswith("__")]
    assert len(rooms) <= ROOMS
    assert len(loose) <= LOOSE


def test_no_file_is_long():
    """The joined header is one file for its users; here it is parts."""
    long = {}
    for path in [*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.[ch]"), *(ROOT / "rules").glob("*")]:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > LINES and path.name != "pandis.h":
            long[path.relative_to(PACKAGE).as_posix()] = lines
    assert long == {}

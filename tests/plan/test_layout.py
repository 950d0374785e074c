"""The order of folders is the rule of imports: from one's own folder, and from those before it."""

import ast

import pytest

from support import ROOT, edit

PACKAGE = ROOT / "workflow/pandis"
#: A module of each imports from those before it, and from its own.
ORDER = (
    *("base", "engine", "runtime", "bridges"),
    *(f"pipeline.{name}" for name in (
        "run", "geometry", "mesh", "kinds", "export", "judge", "report", "check",
    )),
    "__main__",
)  # fmt: skip
#: Folders whose own folders do not import each other.
SIBLINGS = ("bridges",)
LINES = 400


def modules(package):
    """Return the path of every module by its dotted name, without ``pandis.``."""
    paths = {path.relative_to(package): path for path in package.rglob("*.py")}
    names = {
        path.with_suffix("").as_posix().replace("/", "."): file for path, file in paths.items()
    }
    return {name.removesuffix(".__init__"): file for name, file in names.items()}


def imports(path, known):
    """Return the modules of the package that a module imports, wherever it does."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.removeprefix("pandis.") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: imports are absolute"
            base = node.module.removeprefix("pandis.")
            whole = {f"{base}.{alias.name}": base for alias in node.names}
            names |= {name if name in known else base for name, base in whole.items()}
    return names & known.keys()


def place(module):
    """Return the place in the order of a module's folder, and its own folder among siblings."""
    (folder,) = [name for name in ORDER if f"{module}.".startswith(f"{name}.")]
    return ORDER.index(folder), module.split(".")[1:2] if folder in SIBLINGS else None


def faults(package):
    """Return every import that goes to a later folder, or to a sibling."""
    known = modules(package)
    inside = [name for name in known if name not in ("__init__", "pipeline")]
    wrong = []
    for name in inside:
        level, own = place(name)
        for other in imports(known[name], known):
            below, others = place(other)
            if below > level or (below == level and own != others):
                wrong.append(f"{name} imports {other}")
    return wrong


def test_modules_import_from_folders_before_theirs():
    assert faults(PACKAGE) == []


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("base/frame.py", "from pandis.engine import bvh"),
        ("pipeline/judge/stress/work.py", "from pandis.pipeline.report import tables"),
        ("pipeline/run/plan/plan.py", "import pandis.pipeline.report.page"),
        ("runtime/scene/poses.py", "def f():\n    from pandis.bridges.newton.cells import Cells"),
        ("bridges/warp/mujoco.py", "from pandis.bridges.mujoco.instances import instances"),
    ],
)
def test_an_import_against_the_order_is_seen(path, line, workspace):
    package = workspace / "workflow/pandis"
    text = (package / path).read_text()
    edit(package / path, text, f"{text}\n\n{line}\n")
    assert len(faults(package)) == 1


def test_every_folder_has_its_place():
    """In the order there is nothing else, and no module lies loose beside the folders."""
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "pipeline"}
    pipeline = {
        f"pipeline.{path.name}" for path in (PACKAGE / "pipeline").iterdir() if path.is_dir()
    }
    names = {name for name in folders | pipeline if "__pycache__" not in name}
    assert names == set(ORDER) - {"__main__"}
    assert {path.name for path in PACKAGE.glob("*.py")} == {"__init__.py", "__main__.py"}


def test_no_file_is_long():
    """The joined header is one file for its users; here it is parts."""
    long = {}
    for path in [*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.[ch]"), *(ROOT / "rules").glob("*")]:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > LINES and path.name != "pandis.h":
            long[path.relative_to(PACKAGE).as_posix()] = lines
    assert long == {}

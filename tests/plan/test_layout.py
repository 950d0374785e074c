"""The order of folders is the rule of imports: from one's own folder, and from those before it."""

import ast
import functools
import re

import pytest

from pandis.pipeline.run.ask.kinds import KINDS
from support import ROOT, edit

PACKAGE = ROOT / "workflow/pandis"
#: A module of each imports from those before it, and from its own.
ORDER = (
    *("base", "engine", "runtime", "bridges"),
    *(f"pipeline.{name}" for name in (
        "run", "geometry", "mesh", "kinds", "export", "judge", "report", "dataset", "check",
        "api",
    )),
    "commands",
    "__main__",
)  # fmt: skip
#: Folders whose own folders do not import each other, but may what lies beside them.
SIBLINGS = ("bridges", "pipeline.kinds")
LINES = 400
#: Lines of a function in C, from its type to its brace; clang-format puts both in column 1.
FUNCTION = re.compile(r"^[A-Za-z][^;{}#]*\([^;{}]*\{\n.*?^\}", re.M | re.S)
FUNCTION_LINES = 60


def modules(package):
    """Return the path of every module by its dotted name, without ``pandis.``."""
    paths = {path.relative_to(package): path for path in package.rglob("*.py")}
    names = {
        path.with_suffix("").as_posix().replace("/", "."): file for path, file in paths.items()
    }
    return {name.removesuffix(".__init__"): file for name, file in names.items()}


@functools.cache
def statements(text):
    """Return what a module's import statements name: pairs of a module, and a name in it."""
    pairs = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            pairs += [(alias.name.removeprefix("pandis."), "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            base = node.module.removeprefix("pandis.")
            pairs += [(base, alias.name) for alias in node.names]
    return pairs


def imports(path, known):
    """Return the modules of the package that a module imports, wherever it does."""
    pairs = statements(path.read_text(encoding="utf-8"))
    whole = {f"{base}.{name}" if name else base: base for base, name in pairs}
    return {name if name in known else base for name, base in whole.items()} & known.keys()


def place(module, known):
    """Return the place in the order of a module's folder, and its own folder among siblings."""
    (folder,) = [name for name in ORDER if f"{module}.".startswith(f"{name}.")]
    own = module.removeprefix(folder).strip(".").partition(".")[0]
    inside = folder in SIBLINGS and known.get(f"{folder}.{own}", PACKAGE).name == "__init__.py"
    return ORDER.index(folder), own if inside else ""


def faults(package):
    """Return every import that goes to a later folder, or to a sibling."""
    known = modules(package)
    inside = [name for name in known if name not in ("__init__", "pipeline")]
    wrong = []
    for name in inside:
        level, own = place(name, known)
        for other in imports(known[name], known):
            below, others = place(other, known)
            if below > level or (below == level and others not in ("", own)):
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
        ("pipeline/kinds/spline/fit.py", "from pandis.pipeline.kinds.grid import dense"),
        ("pipeline/kinds/sizing.py", "from pandis.pipeline.kinds.network import base"),
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


def test_no_function_in_c_is_long():
    long, count = {}, 0
    for path in (ROOT / "workflow").rglob("*.[ch]"):
        if path.name != "pandis.h":
            functions = FUNCTION.findall(path.read_text(encoding="utf-8"))
            count += len(functions)
            long |= {
                f"{path.name}: {text[:60]}": text.count("\n") + 1
                for text in functions
                if text.count("\n") >= FUNCTION_LINES
            }
    assert count > 400
    assert long == {}


def test_the_name_of_a_kind_stands_in_its_folder_and_in_the_list_alone():
    """But for `exact`, which is also what all is compared with, and the paper's loss."""
    names, strangers = set(KINDS) - {"exact", "paper"}, []
    for path in [*(PACKAGE / "pipeline").rglob("*.py"), *(ROOT / "scripts").glob("*.py")]:
        words = path.parts
        own = "kinds" in words and len(words) > words.index("kinds") + 2
        if own or words[-3:] == ("run", "ask", "kinds.py") or path.stem in ("record", "export_vti"):
            continue  # of these two a grid is the kind of artifact that splines lie in, too
        constants = [
            n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Constant)
        ]
        strangers += [f"{path}: {n.value}" for n in constants if n.value in names]
    assert strangers == []

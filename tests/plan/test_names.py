"""A name says what a thing is: no bare participle is an identifier of the library."""

import ast
import functools
import re

import pytest

from support import ROOT

#: Words that say that something happened, not what came of it.
PARTICIPLES = {"asked", "found", "given", "held", "kept", "made", "own", "said", "told", "wanted"}
FILES = [*(ROOT / "workflow").rglob("*.py"), *(ROOT / "scripts").glob("*.py"),
         *(ROOT / "docs/tools").glob("*.py")]  # fmt: skip
#: Fields of records stand in artifacts by these names.
RECORDS = ROOT / "workflow/pandis/pipeline/run/records"


parsed = functools.cache(ast.parse)


def names_in(tree):
    """Yield line and name of all that a module defines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def bare(source):
    """Return the lines of a source whose names are bare participles, with them."""
    found = ((line, name) for line, name in names_in(parsed(source)))
    return [(line, name) for line, name in found if name.strip("_").lower() in PARTICIPLES]


def test_no_name_is_a_bare_participle():
    files = [path for path in FILES if RECORDS not in path.parents]
    wrong = {path: bare(path.read_text(encoding="utf-8")) for path in files}
    assert {path: names for path, names in wrong.items() if names} == {}


@pytest.mark.parametrize(
    "source",
    ["def told(x): pass", "def f(given): pass", "held = 1", "self._kept = 1", "for own in x: pass",
     "def f(*, asked=1): pass", "with x as found: pass", "lambda made: 1"],
)  # fmt: skip
def test_each_way_to_name_is_seen(source):
    assert len(bare(source)) == 1


def splats(source):
    """Return the lines of calls that take a local tuple apart, which hides what is passed."""
    lines = []
    calls = re.search(r"[(,]\s*\*\w", source)  # few modules have one: others need no walk
    for function in ast.walk(parsed(source)) if calls else ():
        if not isinstance(function, ast.FunctionDef):
            continue
        tuples = {
            target.id
            for node in ast.walk(function)
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for call in ast.walk(function):
            for each in call.args if isinstance(call, ast.Call) else ():
                if isinstance(each, ast.Starred) and getattr(each.value, "id", "") in tuples:
                    lines.append(call.lineno)
    return lines


def test_no_call_takes_a_local_tuple_apart():
    wrong = {path: splats(path.read_text(encoding="utf-8")) for path in FILES}
    assert {path: lines for path, lines in wrong.items() if lines} == {}
    assert splats("def f(a, b):\n    both = a, b\n    return g(*both)") == [3]
    assert splats("def f(both):\n    return g(*both)") == []


def headless(source):
    """Return descriptions of parameters that begin with "Of": the noun is left out."""
    return re.findall(r"^( *)[\w, ]+ : .*\n\1    (Of [a-z`].*)", source, re.M)


def test_no_description_begins_with_of():
    wrong = {path: headless(path.read_text(encoding="utf-8")) for path in FILES}
    assert {path: found for path, found in wrong.items() if found} == {}
    assert headless("radius : float\n    Of the probe, m.") == [("", "Of the probe, m.")]
    assert headless("radius : float\n    Radius of the probe, m.") == []

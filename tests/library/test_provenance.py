import ast
import shutil

import pytest

from pandis.pipeline.run.job.provenance import CodeDigests, Needs, _tree_digest
from support import ROOT, edit


@pytest.fixture
def tree(tmp_path):
    package = tmp_path / "workflow" / "pandis"
    (package / "sub").mkdir(parents=True)
    (tmp_path / "scripts").mkdir()
    (package / "__init__.py").write_text("")
    (package / "sub" / "__init__.py").write_text("")
    (package / "sub" / "page.html").write_text("<p>")
    (package / "a.py").write_text("from pandis.b import f\n")
    (package / "b.py").write_text("def f():\n    from pandis import c\n    return c\n")
    (package / "c.py").write_text("from .sub.d import x\n")
    (package / "sub" / "d.py").write_text("from . import e\nx = 1\n")
    (package / "sub" / "e.py").write_text("y = 2\n")
    (package / "other.py").write_text("z = 3\n")
    (tmp_path / "scripts" / "run.py").write_text("import pandis.a\n")
    return tmp_path


def digests(tree):
    return CodeDigests(tree / "workflow").modules("run")


def test_closure_follows_every_form_of_import(tree):
    assert set(digests(tree)) == {
        "python", "scripts/run", "pandis.a", "pandis.b", "pandis.c",
        "pandis.sub", "pandis.sub.d", "pandis.sub.e",
    }  # fmt: skip


def test_change_anywhere_in_the_closure_counts(tree):
    before = digests(tree)
    edit(tree / "workflow/pandis/sub/e.py", "2", "3")
    after = digests(tree)
    assert {m for m in before if before[m] != after[m]} == {"pandis.sub.e"}
    edit(tree / "workflow/pandis/sub/page.html", "<p>", "<b>")
    assert digests(tree)["pandis.sub"] != after["pandis.sub"]


def test_change_elsewhere_does_not(tree):
    before = digests(tree)
    edit(tree / "workflow/pandis/other.py", "3", "4")
    assert digests(tree) == before


def test_what_is_remembered_of_a_text_is_what_it_is(tree, monkeypatch):
    cache = tree / "cache"
    monkeypatch.setenv("PANDIS_CACHE", str(cache))
    first = digests(tree)
    with monkeypatch.context() as patch:
        patch.setattr(ast, "parse", lambda source: pytest.fail("was parsed again"))
        assert digests(tree) == first
    edit(tree / "workflow/pandis/c.py", "import x", "import y")
    assert digests(tree)["pandis.c"] != first["pandis.c"]
    edit(tree / "workflow/pandis/c.py", "import y", "import x")
    for damage in (lambda text: text[:-5], lambda text: text.replace("a", "b"), lambda text: ""):
        for path in (cache / "texts").iterdir():
            path.write_text(damage(path.read_text()))
        assert digests(tree) == first  # made again, and kept
        assert digests(tree) == first
    shutil.rmtree(cache)
    cache.write_text("no folder")
    assert digests(tree) == first


def test_files_of_an_editor_do_not_count(tree):
    before = digests(tree)
    for name in (".e.py.swp", "e.py~", "e.py.orig", ".DS_Store", ".page.html.swp"):
        (tree / "workflow/pandis/sub" / name).write_text("x")
    assert digests(tree) == before


def test_comments_docstrings_and_layout_do_not_count():
    bare = "def f(x):\n    return x+1\nclass A:\n    pass\n"
    full = '"""Doc."""\n# note\ndef f( x ):\n    """Doc."""\n    return (x + 1)\n'
    full += '\n\nclass A:\n    "Doc"\n'
    assert _tree_digest(ast.parse(bare)) == _tree_digest(ast.parse(full))
    assert _tree_digest(ast.parse(bare)) != _tree_digest(ast.parse(bare.replace("1", "2")))


def test_digest_is_the_same_on_every_python():
    """`ast.unparse` is stable from 3.11 on; a change here restales everybody's results."""
    code = "def f(x: int = 1, *a, **k) -> str:\n    return f'{x!r:>{k}} {a}' if x else {**k}\n"
    assert ast.unparse(ast.parse(code)) == (
        "def f(x: int=1, *a, **k) -> str:\n    return f'{x!r:>{k}} {a}' if x else {**k}"
    )


def test_real_stages_have_digests():
    digests = CodeDigests(ROOT / "workflow")
    assert "pandis.pipeline.mesh.tools" in digests.modules("mesh")
    trained = digests.modules("train", Needs(kinds=("network",)))
    assert "pandis.pipeline.kinds.network.training.paper_loss" in trained
    assert not [module for module in trained if "kinds.grid" in module]
    for stage in ("mesh", "sample", "train", "bake", "evaluate"):
        assert not {"pandis.pipeline.run.ask.config", "pandis.pipeline.run.plan.plan"} & set(
            digests.modules(stage)
        )

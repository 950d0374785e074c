"""What an edit of the code makes stale: the lines that matter, held by hand."""

import shutil

import pytest

from pandis.engine.sources import digest, included, tokens
from pandis.pipeline.run.job.provenance import EVERYTHING, CodeDigests, needs
from stale import stages_by_file
from support import ROOT, edit

STAGES = sorted(path.stem for path in (ROOT / "scripts").glob("*.py"))
#: Stages that ask pandis.h.
ANSWER = {"calibrate", "choose", "evaluate", "export_native", "export_page", "report", "scene"}
ANSWER |= {"collection", "export_mjcf", "export_newton", "export_vdb"}
ANSWER |= {"shard", "stress", "timing", "validate", "verify"}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tree")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "workflow" / "pandis", folder / "workflow" / "pandis", ignore=ignore)
    shutil.copytree(ROOT / "scripts", folder / "scripts", ignore=ignore)
    return folder


def digests(tree, options=None):
    needed = EVERYTHING if options is None else needs(options)
    code = CodeDigests(tree / "workflow")
    return {stage: code.stage(stage, needed) for stage in STAGES}


_KNOWN = {}


def known(tree, options=None):
    """Return the digests of the tree as it is between two edits."""
    key = str(options)
    if key not in _KNOWN:
        _KNOWN[key] = digests(tree, options)
    return _KNOWN[key]


def stale(tree, name, old, new, options=None):
    """Return the stages that an edit of a file makes stale; the file is put back."""
    path = tree / "workflow" / "pandis" / name
    before, text = known(tree, options), path.read_text("utf-8")
    try:
        edit(path, old, new)
        after = digests(tree, options)
    finally:
        path.write_text(text, "utf-8")
    return {stage for stage in STAGES if before[stage] != after[stage]}


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (
            "engine/pandis.h",
            "/* The answer at a point.",
            "/* The answer at a point, and more.\n *",
        ),
        (
            "engine/pandis.h",
            "if (!good || ",
            "if (!good   ||\n        // as it should be\n        ",
        ),
        ("engine/bvh/bvh.c", "\n}\n", "\n}\n// the end\n"),
        ("runtime/device/guard.h", "\n}\n", "\n}\n\n/* a wall */\n"),
        ("base/frame.py", "in which every stage computes", "and why it is one"),
        ("pipeline/kinds/grid/interpolation.py", "\nclass", "\n\n# a grid\nclass"),
        ("base/forces.py", "(distance: Values, normal: Points", "(distance, normal"),
        ("pipeline/run/ask/options.py", 'description="', 'description="in short: '),
        ("__init__.py", '__version__ = "', '__version__ = "9.'),
    ],
)
def test_a_comment_the_layout_or_the_version_makes_nothing_stale(tree, name, old, new):
    assert stale(tree, name, old, new) == set()


def rejoined(tree, part, old, new):
    """Return what an edit of a part of pandis.h makes stale, once the header is joined anew."""
    engine = tree / "workflow" / "pandis" / "engine"
    before, header = known(tree), (engine / "pandis.h").read_text("utf-8")
    path = engine / "parts" / f"{part}.h"
    text = path.read_text("utf-8")
    try:
        edit(path, old, new)
        edit(engine / "pandis.h", text, path.read_text("utf-8"))
        after = digests(tree)
    finally:
        path.write_text(text, "utf-8")
        (engine / "pandis.h").write_text(header, "utf-8")
    return {stage for stage in STAGES if before[stage] != after[stage]}


def test_the_header_makes_stale_what_answers_and_its_trees_what_is_labelled(tree):
    grids = rejoined(tree, "grid", "return a * (1 - t) + b * t;", "return a + (b - a) * t;")
    assert grids == ANSWER
    version = rejoined(tree, "opening", 'PANDIS_VERSION "', 'PANDIS_VERSION "9.')
    assert version <= ANSWER
    trees = rejoined(tree, "mesh", "t <= 0.5 ?", "t < 0.5 ?")
    assert trees > ANSWER | {"mesh", "sample", "bake", "train"}
    sines = rejoined(tree, "sines", "PANDIS__PART1 1.5703125f", "PANDIS__PART1 1.5703126f")
    assert sines == ANSWER | {"bake", "train", "choose", "export_graph"}


def test_a_shard_depends_on_the_code_of_the_fields_that_it_builds():
    code = CodeDigests(ROOT / "workflow")

    def modules(*builds):
        found = code.modules("shard", needs({"builds": dict.fromkeys(builds)}))
        return {name.removeprefix("pandis.pipeline.kinds.") for name in found}

    exports, packs = "native", "compact.packing"
    assert not {exports, packs} & modules()
    assert {exports, packs} & modules("exact") == {exports}
    assert {exports, packs} <= modules("exact", "compact-16")
    assert "pandis.runtime.field" not in code.modules("dataset")


def test_what_drives_a_device_makes_stale_what_is_tried_on_one(tree):
    found = stale(tree, "runtime/device/energy.h", ";", ";;")
    assert "validate" in found
    assert not found & {"mesh", "sample", "train", "bake", "export_native", "evaluate"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "field", "other"),
    [
        ("grid/interpolation", "kim-64", "support-planes"),
        ("paper/proxy", "salisbury-tricubic-64", "kim-64"),
        ("spline/reference", "salisbury-spline-64", "salisbury-tricubic-64"),
    ],
)
def test_a_kind_makes_stale_what_asks_it_without_a_file(tree, module, field, other):
    """What has a file is answered by that: there the file's own bytes decide."""
    name = f"pipeline/kinds/{module}.py"
    change = (name, "\nimport numpy as np\n", "\nimport numpy as np\n\nx = 1\n")
    judges = {"evaluate", "stress", "timing"}
    for fields in (["exact", "trilinear-64", "spline-64", "pandis"], [other]):
        assert not stale(tree, *change, {"fields": fields}) & judges
    assert judges <= stale(tree, *change, {"fields": ["exact", field]})
    shared = {"fields": {"a": ["exact"], "b": [field]}}  # the report's, by mesh
    assert stale(tree, *change, shared) == stale(tree, *change, {"fields": [field]})


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["compact", "grid", "spline", "network"])
def test_of_a_kind_what_builds_and_what_exports_are_apart(tree, kind):
    """Training for hours does not depend on how a file is laid out."""
    names = {"compact": "compact-16", "grid": "tricubic-64", "spline": "spline-64"}
    files = {"field": names.get(kind, "pandis")}
    change = (
        f"pipeline/kinds/{kind}/file.py",
        "    def parts(self)",
        "    x = 1\n\n    def parts(self)",
    )
    assert not stale(tree, *change, {"kind": kind}) & {"bake", "train"}
    assert "export_native" in stale(tree, *change, files)
    for other in {"compact", "grid", "spline", "network"} - {kind}:
        assert "export_native" not in stale(tree, *change, {"kind": other})


def test_the_other_loss_makes_no_network_stale(tree):
    change = ("pipeline/kinds/network/training/paper_loss.py", "\ndef", "\nx = 1\n\n\ndef")
    assert "train" not in stale(tree, *change, {"recipe": {"loss": "exact"}})
    assert "train" in stale(tree, *change, {"recipe": {"loss": "paper"}})


# --- sources in C -------------------------------------------------------------------------


def test_comments_and_layout_do_not_count():
    plain = 'int f(int x) { return x + 1; } /* " */ const char *s = "// no comment";'
    other = "// one\nint f( int x )\n{\n\treturn x+1; /* two\n lines */ }\n"
    other += 'const char*s="// no comment";'
    assert tokens(plain) == tokens(other)
    assert tokens(plain) != tokens(plain.replace("x + 1", "x - 1"))
    assert tokens(plain) != tokens(plain.replace("no comment", "comment"))


def test_where_a_directive_ends_counts():
    assert tokens("#define A b\nc") != tokens("#define A b c\n")
    assert tokens("#define A b \\\n c\n") == tokens("#define A b c\n")
    assert tokens("#define F(x) x\n") != tokens("#define F (x) x\n")
    assert tokens("#  if A // yes\n#endif\n") == tokens("#if A\n#endif\n")
    assert tokens("a\n#define B\n") != tokens("a #define B\n")


def test_what_words_are_made_of_counts():
    assert tokens("int a;") != tokens("inta;")
    assert tokens("a - -b") != tokens("a--b")
    assert tokens("1.5e3f") == ["1.5e3f"]


def test_includes_are_followed_and_each_counts_once(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.c").write_text('#include "../b.h"\n#include <math.h>\nint a;\n')
    (tmp_path / "b.h").write_text(' # include "sub/c.h"\nint b;\n')
    (tmp_path / "sub" / "c.h").write_text('#include "../b.h"\nint c;\n')
    names = [path.name for path in included(tmp_path / "sub" / "a.c")]
    assert names == ["a.c", "b.h", "c.h"]
    before = digest(tmp_path / "sub" / "a.c")
    edit(tmp_path / "sub" / "c.h", "int c", "long c")
    assert digest(tmp_path / "sub" / "a.c") != before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("pipeline/mesh/repair.py", "\nimport numpy as np\n", "\nimport numpy as np\n\nx = 1\n"),
        ("engine/bvh/bvh.c", "\n}\n", "\n}\nint x;\n"),
        ("runtime/device/energy.h", ";", ";;"),
        ("pipeline/report/page.html", "<h1>", "<h1> "),
    ],
)
def test_the_tool_says_what_an_edit_makes_stale(name, old, new, tree):
    """Both the paper's methods and losses count there, whatever a configuration asks."""
    listed = stages_by_file(tree)[(tree / "workflow/pandis" / name).resolve()]
    assert listed == stale(tree, name, old, new)

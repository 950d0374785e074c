"""The shape that every rule has, and what planning may import."""

import re
import subprocess
import sys

import pytest

from support import ROOT, environment

RULES = {
    name: body
    for path in sorted((ROOT / "rules").glob("*.smk"))
    for name, body in re.findall(
        r"^rule (\w+):\n((?:    .*\n|\n)+)", path.read_text(encoding="utf-8"), re.M
    )
    if path.name != "targets.smk"
}
#: What users call, and no stage.
ENTRANCES = [ROOT / "workflow/pandis" / name for name in ("__init__.py", "__main__.py")]
KINDS_FILE = ROOT / "workflow/pandis/pipeline/run/ask/kinds.py"
HEAVY = ("torch", "trimesh", "igl", "pymeshlab", "onnx", "onnxruntime", "matplotlib", "numpy")


def test_there_are_rules():
    assert len(RULES) >= 13


@pytest.mark.parametrize("name", RULES)
def test_rule_has_the_common_shape(name):
    body = RULES[name]
    directives = re.findall(r"^    (\w+):", body, re.M)
    order = [
        "input", "output", "log", "benchmark", "retries", "priority", "conda", "threads",
        "resources", "params", "message", "script",
    ]  # fmt: skip
    assert [d for d in order if d in directives] == directives
    wanted = {"log", "benchmark", "conda", "resources", "params", "message", "script"}
    if name == "verify":  # Snakemake takes a benchmark for an output, and runs no check twice
        wanted -= {"benchmark"}
        assert not {"benchmark", "output"} & set(directives)
    assert wanted <= set(directives)
    assert f'"../scripts/{name}.py"' in body
    assert (ROOT / "scripts" / f"{name}.py").is_file()
    assert f'options=plan.options("{name}"),' in body
    assert f'code=plan.code("{name}"),' in body
    assert re.search(r"mem_mb=\d+,\n +runtime=\d+,", body)
    assert "lambda" not in body


def test_every_script_has_a_rule():
    assert {path.stem for path in (ROOT / "scripts").glob("*.py")} == set(RULES)


def test_clocked_rules_claim_all_cores():
    for name in ("timing", "validate", "calibrate", "scene"):
        assert "threads: all_cores" in RULES[name]


def test_no_rule_runs_shell_or_inline_code():
    for path in [ROOT / "workflow/Snakefile", *(ROOT / "rules").glob("*.smk")]:
        assert not re.search(r"^\s+(shell|run):", path.read_text(encoding="utf-8"), re.M), path


def test_no_module_hides_an_import():
    """The code digest follows import statements: anything else would be missed."""
    for path in (ROOT / "workflow/pandis").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        # what the package's users ask for, and what is followed by the names of modules
        if path in (*ENTRANCES, KINDS_FILE):
            continue
        assert "import_module(" not in text, path
        assert "__import__" not in text, path


def loaded_by(statement):
    code = f"import sys; {statement}; print(*[m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=environment(PYTHONPATH=str(ROOT / "workflow")),
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())


def test_planning_imports_nothing_heavy():
    config = {"meshes": {"a": {"source": "analytic:sphere"}}}
    heavy = loaded_by(
        "from pandis.pipeline.run.plan.plan import Plan; "
        f"p = Plan({config!r}, 'workflow'); p.target('all'); "
        "[p.code(s)({'mesh': 'a', 'recipe': 'pandis'}) for s in ('mesh', 'train', 'evaluate')]; "
        "p.code('report')({})"
    )
    assert heavy == set()


#: All scripts are imported one after the other: none may bring in what none needs.
_IMPORTS = """
import sys
for line in sys.stdin:
    name, imports = line.split("|")
    exec(imports)
    print(name, *[m for m in ("torch", "pymeshlab") if m in sys.modules], flush=True)
"""


def test_no_script_imports_what_only_some_runs_need():
    lines = []
    for name in sorted(RULES):
        source = (ROOT / "scripts" / f"{name}.py").read_text(encoding="utf-8")
        lines.append(f"{name}|{'; '.join(re.findall(r'^from pandis.*$', source, re.M))}\n")
    done = subprocess.run(
        [sys.executable, "-c", _IMPORTS],
        input="".join(lines),
        cwd=ROOT,
        env=environment(PYTHONPATH=str(ROOT / "workflow")),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split("\n") == [*sorted(RULES), ""]  # the first culprit names a package

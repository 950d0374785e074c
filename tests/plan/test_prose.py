"""What pages and messages say: commands can be typed, options exist, comparisons hold."""

import ast
import contextlib
import csv
import io
import re
import shlex

import pytest
from snakemake.cli import get_argument_parser

from pandis.pipeline.run.ask.config import MeshEntry, StageOptions
from pandis.pipeline.run.plan.plan import TARGETS
from support import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config/README.md",
         *sorted((ROOT / "docs").rglob("*.md"))]  # fmt: skip
CODE = sorted((ROOT / "workflow").rglob("*.py"))
SECTIONS = [name for name, field in StageOptions.model_fields.items()
            if hasattr(field.annotation, "model_fields") or name == "train"]  # fmt: skip
RULES = {name for path in (ROOT / "rules").glob("*.smk")
         for name in re.findall(r"^rule (\w+):", path.read_text(), re.M)}  # fmt: skip


def commands():
    """Yield file and every command of Snakemake that a page or a message names."""
    for path in [*PAGES, *CODE]:
        text = path.read_text(encoding="utf-8")
        for line in re.findall(r"(?:`|^|[:;] )(snakemake(?: +[^`\n#;]+)?)", text, re.M):
            if re.match(r"snakemake +(-|[a-z]+$)", line):
                yield path.name, re.sub(r"\\n.*|\"|\)$", "", line).strip()


def options_of(command):
    """Return what Snakemake understands of a command, or raise a ValueError."""
    words = shlex.split(re.sub(r"[{}<>]", "", command))[1:]
    with contextlib.redirect_stderr(io.StringIO()) as said:
        try:
            return get_argument_parser().parse_args(words)
        except SystemExit as error:
            raise ValueError(f"{command}: {said.getvalue().splitlines()[-1]}") from error


def fault(command):
    """Say what is wrong with a command; an empty text if nothing is."""
    try:
        given = options_of(command)
    except ValueError as error:
        return str(error)
    runs = not (given.dryrun or given.unlock or given.lint or given.report or given.profile)
    if runs and not given.cores and not given.jobs:
        return f"{command}: Snakemake wants a number of cores: -j2"
    for target in given.targets:
        if not (target in TARGETS | RULES | {"all"} or "/" in target or target == "path"):
            return f"{command}: there is no target {target}"
    return ""


def test_every_command_can_be_typed():
    found = list(commands())
    assert len(found) > 30
    assert [f"{page}: {wrong}" for page, command in found if (wrong := fault(command))] == []


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("snakemake -f calibrate", "wants a number of cores"),
        ("snakemake -j2 --fource all", "unrecognized arguments|ambiguous"),
        ("snakemake -j2 reprot", "there is no target reprot"),
    ],
)
def test_a_command_that_fails_is_seen(command, said):
    assert re.search(said, fault(command))


def messages():
    """Yield file and text of every constant that is no docstring."""
    for path in (ROOT / "workflow/pandis").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        notes = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            text = getattr(node, "value", None)
            if isinstance(text, str) and id(node) not in notes:
                yield path.name, text
    for path in PAGES:
        if path.name == "upgrading.md":  # it lists the names of C and Python
            continue
        for text in re.findall(r"`([^`\n]+)`", path.read_text(encoding="utf-8")):
            yield path.name, text


def exists(option):
    """Tell whether the configuration has an option, by its dotted path."""
    model = MeshEntry
    for key in option.split("."):
        field = getattr(model, "model_fields", {}).get(key)
        if field is None:
            return False
        model = field.annotation
        if not hasattr(model, "model_fields"):
            return True  # what follows are names of the user's
    return True


def test_every_option_that_is_named_exists():
    pattern = rf"(?<![\w./{{])(?:{'|'.join(SECTIONS)})\.[a-z_]+(?:\.[a-z_]+)*(?![\w(])"
    files = re.compile(r"\.(zarr|json|obj|py|c|h|html|csv|smk|surfaces|load|md|deviation_)\b|\._")
    wrong, found = [], set()
    for page, text in messages():
        for option in re.findall(pattern, text):
            if not files.search(option):
                found.add(option)
                wrong += [] if exists(option) else [f"{page}: {option}"]
    assert wrong == []
    assert len(found) > 30


def test_an_option_that_is_none_is_seen():
    assert exists("hardware.attached.model")
    assert exists("bake.auto.spline")
    assert not exists("hardware.force_limit")


def table(name):
    """Return the rows of a table of docs/figures."""
    with (ROOT / f"docs/figures/{name}.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def column(name, key, value, **where):
    """Return a column of a table of docs/figures as numbers, by another one."""
    wanted = [row for row in table(name) if all(row[k] == v for k, v in where.items())]
    return {row[key]: float(row[value]) for row in wanted if re.fullmatch(r"[-\d.e+]+", row[value])}


BUNNY = {"mesh": "bunny"}
ERROR = column("default", "field", "contact_mean", **BUNNY)
MISSING = column("default", "field", "missing_percent", **BUNNY)
TIME = column("default", "field", "native_p50_us", **BUNNY)
BYTES = column("default", "field", "bytes", **BUNNY)
IN_C = column("native", "field", "median_us", way="pandis.h")
PRESSES = {key: sum(int(row[key] or 0) for row in table("presses"))
           for key in ("presses", "passes", "penalty_passes")}  # fmt: skip
TRAINED = {}
for _row in table("full"):
    TRAINED.setdefault((_row["mesh"], _row["field"]), []).append(float(_row["contact"]))
#: Contact error, and share of the surface without force, by mesh, kind and KB.
SMALL = {(row["mesh"], row["kind"].removesuffix("-auto"), int(row["budget"]) // 1000):
         (float(row["contact"]), float(row["missing"])) for row in table("small")}  # fmt: skip
#: Microseconds a query by mesh, points and way.
PEERS = {(row["mesh"], row["points"], row["way"]): float(row["median_us"] or row["mean_us"])
         for row in table("peers")}  # fmt: skip
OURS = ("pandis exact", "pandis compact-16")
STEP = column("throughput_cpu", "what", "ms")
SOUND = ("exact", "compact-auto", "spline-auto", "pandis-exact")
#: Sentences that compare, by page, and what their tables must show.
CLAIMS = [
    ("README.md", "`compact-auto` where bytes count",
     BYTES["compact-auto"] < min(BYTES["exact"], BYTES["spline-auto"])),
    ("README.md", "Networks need long training and are slowest to query",
     min(TIME["pandis"], TIME["pandis-exact"]) > max(TIME[f] for f in TIME if "pandis" not in f)),
    ("docs/benchmarks/accuracy.md", "push back on\nall of the bunny's surface",
     all(MISSING[field] == 0 for field in SOUND)),
    ("docs/benchmarks/accuracy.md", "the paper's grids and its network lack part of it",
     all(MISSING[f] > 0.5 for f in ("nearest-64", "trilinear-64", "trilinear-box-64", "pandis"))),
    ("docs/benchmarks/accuracy.md", "than the network of equal bytes; trained to the end",
     ERROR["spline-auto"] < ERROR["pandis-exact"]
     and abs(BYTES["spline-auto"] / BYTES["pandis-exact"] - 1) < 0.01),
    ("docs/benchmarks/accuracy.md", "The paper's own recipe errs at least five times as much",
     all(column("default", "field", key, **BUNNY)["pandis"]
         > 5 * column("default", "field", key, **BUNNY)["pandis-exact"]
         for key in ("contact_mean", "shallow_mean", "deep_mean"))),
    ("docs/benchmarks/accuracy.md", "answers much faster than a network",
     10 * TIME["exact"] < min(TIME["pandis"], TIME["pandis-exact"])),
    ("docs/benchmarks/size.md", "Up to 100 KB a spline's mean error on scans is smaller",
     all(SMALL[mesh, "spline", size][0] < SMALL[mesh, "compact", size][0]
         for mesh in ("bunny", "armadillo", "dragon") for size in (50, 100))),
    ("docs/benchmarks/size.md", "lacks the force on a larger part\nof the surface at 100 KB",
     all(SMALL[mesh, "spline", 100][1] > SMALL[mesh, "compact", 100][1]
         for mesh in ("bunny", "armadillo", "dragon"))),
    ("docs/benchmarks/size.md", "From 400 KB on the compact mesh has the smaller error on all six",
     all(error < SMALL[mesh, "spline", size][0] and missing <= SMALL[mesh, "spline", size][1]
         for (mesh, kind, size), (error, missing) in SMALL.items()
         if kind == "compact" and size >= 400)),
    ("docs/benchmarks/query-time.md", "in less time than each of the others at every set of points",
     all(max(PEERS[mesh, points, way] for way in OURS) < time
         for (mesh, points, way), time in PEERS.items() if way not in OURS)),
    ("docs/benchmarks/query-time.md", "The spline answers faster than the exact mesh",
     IN_C["spline-auto"] < IN_C["exact"]),
    ("docs/benchmarks/query-time.md", "exact answers take over a thousand times as long",
     column("native", "way", "of_native", field="exact")["all faces, in C"] > 1000),
    ("docs/benchmarks/query-time.md", "about a microsecond on a mesh",
     max(IN_C[field] for field in IN_C if "network" not in field) < 1.2
     and min(IN_C[field] for field in IN_C if "network" in field) > 8),
    ("docs/benchmarks/building.md", "Labels are computed more than twice as fast as by libigl",
     all(value > 2 for value in column("distances", "what", "ratio",
                                       case="ours, every sign checked").values())),
    ("docs/benchmarks/contact.md", "No press went through a proxy. With penalty forces most",
     PRESSES["passes"] == 0 and 2 * PRESSES["penalty_passes"] > PRESSES["presses"]),
    ("docs/benchmarks/simulators.md", "far smaller errors than MuJoCo's own field",
     all(20 * column("simulator", "field", "shallow", scene=scene)[field]
         < column("simulator", "field", "shallow", scene=scene)["native-6"]
         for scene in ("ball", "peg") for field in ("exact", "compact-16"))),
    ("docs/benchmarks/ablations.md", "errs several times less than the paper's network",
     all(3 * max(TRAINED[mesh, "pandis-exact"]) < min(TRAINED[mesh, "pandis"])
         and 3 * max(TRAINED[mesh, "pandis-exact"]) < min(TRAINED[mesh, "trilinear-box-64"])
         for mesh in ("bunny", "armadillo", "dragon"))),
    ("docs/training.md", "A query takes longer (README's table)",
     TIME["pandis-exact"] > TIME["pandis"]),
    ("docs/benchmarks/building.md", "On two cores, matrix products take two thirds of a step",
     0.6 < STEP["products of such shapes alone"] / STEP["ours, points at hand"] < 0.72),
]  # fmt: skip


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if p.parent.name != "config"],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_a_page_is_short(page):
    assert page.read_text(encoding="utf-8").count("\n") <= 200


@pytest.mark.parametrize(("page", "sentence", "holds"), CLAIMS, ids=[c[1][:40] for c in CLAIMS])
def test_comparisons_are_those_of_the_tables(page, sentence, holds):
    assert sentence in (ROOT / page).read_text(encoding="utf-8")
    assert holds


def test_the_readme_is_short_and_every_page_is_listed():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700
    index = (ROOT / "docs/README.md").read_text(encoding="utf-8")
    pages = {path.name for path in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert {name for name in pages if f"]({name})" not in index} == set()


def test_the_page_of_the_header_has_each_public_function_once():
    """Its prototype with its comment: the header holds the definition, too, under another one."""
    header = (ROOT / "workflow/pandis/engine/pandis.h").read_text(encoding="utf-8")
    public = set(re.findall(r"^PANDIS_API [^;{]*?\b(pandis_[a-z]\w*)\(", header, re.M))
    page = (ROOT / "docs/api/c.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `[^`]*?\b(pandis_[a-z]\w*)\(", page, re.M)
    assert sorted(rows) == sorted(public)
    assert "{" not in page

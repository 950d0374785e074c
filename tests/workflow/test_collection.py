"""A configuration that ends with its exports: one table of many meshes."""

import csv
from types import SimpleNamespace

import pytest
import yaml
from snakemake.settings.types import MaxJobsPerTimespan

from browser import Browser
from pandis.base.errors import PandisError
from pandis.pipeline.report.collection import COLUMNS, build
from pandis.pipeline.run.host import scheduling
from pandis.pipeline.run.plan.plan import Plan
from support import ROOT, copy_workflow, plan, snakemake

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

CONFIG = "config/many.yaml"
MANY = {
    "until": "exports",
    "fields": ["exact", "compact-16"],
    "meshes": {"sphere": {"source": "analytic:sphere"}, "dot": {"source": "dot.obj"}},
}


def planned(**changes):
    return Plan({"meshes": {"a": {"source": "analytic:torus"}}} | changes, ROOT / "workflow")


def test_nothing_beyond_exports_is_planned():
    whole, short = planned(), planned(until="exports")
    left_out = {o.stage for o in whole.everything()} - {o.stage for o in short.everything()}
    assert left_out == {"trajectory", "evaluate", "stress", "timing", "validate", "summary",
                        "report"}  # fmt: skip
    assert [output.path for output in short.everything()][-2:] == [
        "results/collection.csv", "results/collection.html",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"until": "export"}, "until: expected meshes, samples, exports, or nothing"),
        ({"until": "exports", "scenes": {"s": {"objects": {"o": {"mesh": "a", "field": "exact"}}}}},
         "until: scenes build what they need"),
    ],
)  # fmt: skip
def test_other_ends_are_refused(changes, said):
    with pytest.raises(PandisError, match=said):
        planned(**changes)


@pytest.mark.parametrize("until", ["meshes", "samples"])
def test_meshes_and_samples_need_no_network(until):
    for fields in (["exact"], ["pandis-exact"]):
        paths = [o.path for o in planned(until=until, fields=fields).everything()]
        made = ["mesh.zarr.zip", "samples.zarr.zip"][: 1 + (until == "samples")]
        assert paths == [f"results/a/{name}" for name in made] + [
            "results/collection.csv", "results/collection.html"
        ]  # fmt: skip
    assert planned(fields=["exact"]).target("samples") == ["results/a/samples.zarr.zip"]
    assert not any("samples" in o.path for o in planned(fields=["exact"]).everything())


CUP = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 4 3 2\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"""


def test_a_failed_run_ends_with_what_failed_and_the_option_that_helps(tmp_path):
    folder = copy_workflow(ROOT, tmp_path / "run")
    (folder / "cup.obj").write_text(CUP)
    meshes = {"sphere": {"source": "analytic:sphere"}, "cup": {"source": "cup.obj"}}
    few = {"surface": 10, "near": 10, "volume": 10, "held_out": 0}
    few |= dict.fromkeys(("offsets", "shallow", "penetration", "bent", "core", "box"), 0)
    config = {"fields": ["exact"], "until": "samples", "samples": few, "meshes": meshes}
    (folder / CONFIG).write_text(yaml.safe_dump(config | {"results": str(tmp_path / "elsewhere")}))
    done = snakemake(folder, "-j2", "--configfile", CONFIG)
    assert done.returncode == 1
    end = done.stdout[done.stdout.index("A job failed or was stopped:") :]
    assert "A traceback, if there is one, is above." in end
    (row,) = [line.split(None, 2) for line in end.splitlines() if line.startswith("  ")]
    assert row[:2] == ["cup", "mesh"]
    assert row[2].startswith("the mesh is open")
    assert "set `mesh: {open: cap}` for this mesh" in row[2]
    assert (tmp_path / "elsewhere/sphere/samples.zarr.zip").is_file()
    meshes["cup"]["mesh"] = {"open": "cap"}
    (folder / CONFIG).write_text(yaml.safe_dump(config | {"results": str(tmp_path / "elsewhere")}))
    done = snakemake(folder, "-j2", "--configfile", CONFIG)
    assert done.returncode == 0, done.stdout
    with (tmp_path / "elsewhere/collection.csv").open() as table:
        assert {row["mesh"] for row in csv.DictReader(table)} == {"sphere", "cup"}


def rows_of(folder):
    text = (folder / "results/collection.csv").read_text(encoding="utf-8")
    return [*csv.DictReader(text.splitlines())]


def test_jobs_are_looked_for_only_when_one_has_ended(tmp_path):
    """By itself Snakemake does so once a second more for every job, and soon does nothing else."""
    folder = copy_workflow(ROOT, tmp_path / "run")
    shapes = {f"sphere-{k}": {"source": "analytic:sphere"} for k in range(3)}
    (folder / CONFIG).write_text(yaml.safe_dump(MANY | {"meshes": shapes}))
    done = snakemake(folder, "-j1", "--verbose", "meshes", "--configfile", CONFIG)
    assert done.returncode == 0, done.stdout
    assert 1 <= done.stdout.count("Ready jobs: ") <= len(shapes) + 1  # and the target


def test_a_limit_that_somebody_asked_for_stays():
    for asked, left in (("100/1s", None), ("1/1m", "a limiter")):
        limit = MaxJobsPerTimespan.parse_choice(asked)
        run = SimpleNamespace(
            scheduling_settings=SimpleNamespace(max_jobs_per_timespan=limit),
            scheduler=SimpleNamespace(job_rate_limiter="a limiter"),
        )
        scheduling.wait_for_jobs(run)
        assert run.scheduler.job_rate_limiter == left


def test_every_mesh_is_accounted_for(tmp_path):
    """What fails stands in the table with its reason; once it is mended, the table is a result."""
    folder = copy_workflow(ROOT, tmp_path / "run")
    (folder / CONFIG).write_text(yaml.safe_dump(MANY))
    (folder / "dot.obj").write_text("v 0 0 0\n")
    done = snakemake(folder, "-j2", "all", "--configfile", CONFIG)
    assert done.returncode != 0
    assert "give reasons for those left out: dot" in done.stdout
    rows = rows_of(folder)
    assert [(row["mesh"], row["file"]) for row in rows] == [
        ("dot", ""), ("sphere", "exact.pandis"), ("sphere", "compact-16.pandis"),
    ]  # fmt: skip
    assert "it has no faces" in rows[0]["refused"]
    page = (folder / "results/collection.html").read_text(encoding="utf-8")
    assert rows[0]["refused"].split(" (")[0] in page
    (folder / CONFIG).write_text(
        yaml.safe_dump(MANY | {"meshes": {"sphere": MANY["meshes"]["sphere"]}})
    )
    assert plan(folder, CONFIG) == {("collection", None)}
    done = snakemake(folder, "-j2", "all", "--configfile", CONFIG)
    assert done.returncode == 0, done.stdout
    assert "refused" not in rows_of(folder)[0]
    assert snakemake(folder, "-j2", "verify", "--configfile", CONFIG).returncode == 0
    table = folder / "results/collection.csv"
    size = rows_of(folder)[0]["bytes"]
    assert size in table.read_text()
    table.write_text(table.read_text().replace(size, f"{size}1"))
    done = snakemake(folder, "-j2", "verify", "--configfile", CONFIG)
    assert done.returncode != 0
    assert "results/collection.csv  differs from the page beside it" in done.stdout


def test_rows_are_found_by_what_they_say(tmp_path):
    """Of hundreds of rows, in a browser; what a source is called is no markup."""
    names = [f"m{number:03}" for number in range(300)]
    rows = [dict.fromkeys(COLUMNS, 1) | {"mesh": name, "source": "<b>a & b</b>", "bytes": 10,
            "moved_percent": 0.25, "picture": ""} for name in names]  # fmt: skip
    (tmp_path / "page.html").write_text(build(rows, {"x": "<i>no</i> faces"}), encoding="utf-8")
    shown = "[...document.querySelectorAll('#meshes tbody tr')].filter((r) => !r.hidden).length"
    with Browser(tmp_path) as browser:
        browser.open(tmp_path / "page.html")
        assert browser.value(shown) == 300
        browser.value("(() => { find.value = 'M29'; find.dispatchEvent(new Event('input')); })()")
        assert browser.value(shown) == 10
        assert browser.value("document.querySelector('#meshes td:nth-child(3)').textContent") == (
            "<b>a & b</b>"
        )
        assert browser.value("document.querySelectorAll('i').length") == 0
        assert browser.said == []

"""What the tests of clusters and stores run, and which of its results reproduce."""

import yaml

from shapes import box
from support import ROOT, copy_workflow

CONFIG = ("--configfile", "config/small.yaml")
#: One object, as little of everything as may be.
SMALL = {
    "train": {"pandis-exact": {"width": 16, "depth": 2, "steps": 60, "batch": 256}},
    "samples": dict.fromkeys(("surface", "offsets", "shallow", "penetration"), 5000),
    "evaluation": {"probes": 2000},
    "stress": {"ticks": 5000, "loops": 2},
    "timing": {"queries": 100, "cold": 2},
    "hardware": {"seconds": 0.3, "loaded_seconds": 0.1},
}
#: What holds durations, or is made from what does.
MEASURED = {"timing.zarr.zip", "hardware.zarr.zip", "hardware.json", "report.html", "summary.csv"}
#: Folders of no results.
PASSING = {"logs", "benchmarks", ".resume"}


def copied(folder, fields, meshes):
    """Copy the workflow there, with a small configuration of these besides the others."""
    copy_workflow(ROOT, folder)
    asked = SMALL | {"fields": fields, "meshes": meshes}
    (folder / "config/small.yaml").write_text(yaml.safe_dump(asked))
    return folder


def with_data_set(folder):
    """Copy the workflow there, with a data set of three meshes, of which one is broken."""
    copied(folder, ["exact"], {})
    config = yaml.safe_load((folder / "config/small.yaml").read_text())
    samples = {"surface": 500, "near": 500, "volume": 500}
    config["datasets"] = {"parts": {"source": "parts", "samples": samples, "shards": 2}}
    (folder / "config/small.yaml").write_text(yaml.safe_dump(config))
    (folder / "parts").mkdir()
    box((20, 10, 10), 5).export(folder / "parts/box.obj")
    box((1, 2, 3), 1).export(folder / "parts/small.obj")
    (folder / "parts/broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    return folder


def results(folder):
    """Return the results below a folder that reproduce: the path of each by its name."""
    return {str(path.relative_to(folder)): path for path in (folder / "results").rglob("*")
            if path.is_file() and path.name not in MEASURED
            and not PASSING & {*path.relative_to(folder).parts}}  # fmt: skip


def differing(one, other):
    """Return the names of results that two folders do not have alike, byte for byte."""
    mine, others = results(one), results(other)
    return [name for name in {**mine, **others}
            if name not in mine or name not in others
            or mine[name].read_bytes() != others[name].read_bytes()]  # fmt: skip

"""Volumes: OpenVDB and NanoVDB read them, and find the field's distances at every voxel."""

import json
import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from pandis.__main__ import main
from pandis.base.errors import PandisError
from pandis.bridges.vdb.leaves import leaves
from pandis.bridges.vdb.vdb import vdb_bytes
from pandis.bridges.vdb.writing import write_volume
from pandis.runtime.field import NativeField
from pandis.runtime.samples import sample
from support import ROOT

#: Debian's Python, whose package python3-openvdb reads volumes.
PYTHON = "/usr/bin/python3"
READ = """
import json, sys
import pyopenvdb
grid, = pyopenvdb.readAll(sys.argv[1])[0]
box = grid.evalActiveVoxelBoundingBox()
points, values = json.load(open(sys.argv[2])), grid.getAccessor()
seen = [values.probeValue(tuple(point)) for point in points]
print(json.dumps([grid.name, grid.gridClass, grid.background, grid.transform.voxelSize(), box,
                  grid.activeVoxelCount(), grid.transform.indexToWorld((1, 2, 3)), seen]))
"""
NANO = """
#include <nanovdb/util/IO.h>
#include <cstdio>
int main(int count, char **names) {
    auto handle = nanovdb::io::readGrid(names[1]);
    auto *grid = handle.grid<float>();
    FILE *file = fopen(names[2], "r");
    if (!grid || !file) return 1;
    auto values = grid->getAccessor();
    auto there = grid->indexToWorld(nanovdb::Vec3d(1, 2, 3));
    printf("%.17g %.17g %.17g\\n", there[0], there[1], there[2]);
    for (int x, y, z; fscanf(file, "%d %d %d", &x, &y, &z) == 3;)
        printf("%.9g\\n", values.getValue(nanovdb::Coord(x, y, z)));
    return 0 * count;
}
"""


def places(field, voxel, count=4000):
    """Return voxels (n, 3) in the field's box and around it."""
    low, high = field.frame.to_mesh([[-1.2] * 3, [1.2] * 3]) / voxel
    return np.random.default_rng(2).integers(low, high, (count, 3))


def by_openvdb(path, points, folder):
    if (
        not os.path.exists(PYTHON)
        or subprocess.run(
            [PYTHON, "-c", "import pyopenvdb"], capture_output=True, check=False
        ).returncode
    ):
        pytest.skip("no OpenVDB here: apt-get install python3-openvdb")
    asked = folder / "points.json"
    asked.write_text(json.dumps(points.tolist()))
    command = [PYTHON, "-c", READ, path, asked]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("name", ["exact", "compact", "spline", "tricubic", "torus"])
def test_openvdb_reads_the_fields_distances(name, files, tmp_path):
    """At each voxel to the last bit, and the side of every other; twice the same bytes."""
    field, voxel = NativeField(files[name]), 0.05
    path = tmp_path / "field.vdb"
    write_volume(field, path, voxel=voxel, band=2.5)
    points = places(field, voxel)
    read = by_openvdb(path, points, tmp_path)
    told, kind, background, sizes, (low, high), count, there, seen = read
    assert (told, kind) == ("distance", "level set")
    assert background == pytest.approx(2.5 * voxel)
    assert sizes == pytest.approx([voxel] * 3)
    assert there == pytest.approx([voxel, 2 * voxel, 3 * voxel])
    values, active = np.array([s[0] for s in seen]), np.array([s[1] for s in seen])
    wanted = field.query(points * voxel).distance
    near = np.abs(wanted) < background * (1 - 1e-6)
    assert np.array_equal(values[active], wanted[active].astype(np.float32))
    assert active[near].all()
    assert near.sum() > 100
    assert ((values < 0) == (wanted < 0)).all()
    assert (np.abs(values[~active]) == np.float32(background)).all()
    inside = points[near]
    assert (inside >= low).all()
    assert (inside <= high).all()
    assert count > len(inside)
    again = tmp_path / "again.vdb"
    write_volume(field, again, voxel=voxel, band=2.5)
    assert again.read_bytes() == path.read_bytes()


def test_a_volume_may_lie_across_the_origin_of_the_tree(tmp_path):
    """In all eight nodes around voxel 0, and in other units."""
    field = sample("sphere", 1.0)
    path = tmp_path / "field.vdb"
    write_volume(field, path, voxel=0.5, length=10.0)
    points = places(field, 0.05)
    *_, seen = by_openvdb(path, points, tmp_path)
    values = np.array([s[0] for s in seen])
    wanted = 10 * field.query(points * 0.05).distance
    assert values == pytest.approx(np.clip(wanted, -1.5, 1.5), abs=1e-6)


def test_nanovdb_reads_the_fields_distances(files, tmp_path):
    """All of the inside, and outside as far as the band goes."""
    pytest.importorskip("warp", reason="no Warp here: pip install warp-lang")
    if not shutil.which("g++") or not os.path.exists("/usr/include/nanovdb/NanoVDB.h"):
        pytest.skip("no NanoVDB here: apt-get install libnanovdb-dev")
    field, voxel = NativeField(files["compact"]), 0.05
    path, source, program = (tmp_path / n for n in ("field.nvdb", "read.cpp", "read"))
    write_volume(field, path, voxel=voxel)
    source.write_text(NANO)
    subprocess.run(["g++", "-O1", "-std=c++17", source, "-o", program], check=True)
    points = places(field, voxel)
    (tmp_path / "points").write_text("\n".join("{} {} {}".format(*point) for point in points))
    done = subprocess.run([program, path, tmp_path / "points"], capture_output=True, text=True,
                          check=True)  # fmt: skip
    there, *values = done.stdout.split("\n")[:-1]
    assert np.array(there.split(), float) == pytest.approx([voxel, 2 * voxel, 3 * voxel])
    values, wanted = np.array(values, float), field.query(points * voxel).distance
    background = 3 * voxel
    known = wanted < background * (1 - 1e-6)
    clipped = np.clip(wanted, -background, background)
    assert known.sum() > 200
    assert values[known] == pytest.approx(clipped[known], abs=1e-6)
    assert (values[~known] > 0).all()


def test_a_narrower_band_takes_fewer_blocks(files):
    field = NativeField(files["exact"])
    sizes = [len(vdb_bytes({"a": leaves(field, 0.05, band)})) for band in (1.0, 3.0, 9.0)]
    assert sizes[0] < sizes[1] < sizes[2]


@pytest.mark.parametrize(
    ("name", "asked", "said"),
    [
        ("nearest", {}, "a grid of forces"),
        ("exact", {"voxel": 0.0}, "voxel: 0.0 is not a positive number"),
        ("exact", {"band": float("nan")}, "band: nan is not a positive number"),
        ("exact", {"voxel": 1e-6}, "so small that"),
        ("exact", {"voxel": 50.0}, "so large that no voxel lies inside"),
    ],
)
def test_what_makes_no_volume_is_said(name, asked, said, files, tmp_path):
    path = tmp_path / "field.vdb"
    with pytest.raises(PandisError, match=said):
        write_volume(NativeField(files[name]), path, **asked)
    with pytest.raises(PandisError, match="file name must end in"):
        write_volume(NativeField(files["exact"]), tmp_path / "field.txt")
    assert not list(tmp_path.iterdir())


def test_the_programs_of_the_page_run(files, tmp_path, monkeypatch):
    """The command and the lines of Python, as they stand but for the field."""
    page = (ROOT / "docs/volumes.md").read_text(encoding="utf-8")
    page = page.replace("results/bunny/export/compact-auto.pandis", str(files["compact"]))
    page = page.replace("0.005", "0.05")
    monkeypatch.chdir(tmp_path)
    (command,) = re.findall("```bash\npandis (.*?)\n```", page)
    assert main(command.split()) == 0
    first = (tmp_path / "bunny.vdb").read_bytes()
    (text,) = re.findall("```python\n(.*?)```", page, re.S)
    exec(text, {})
    assert len((tmp_path / "bunny.vdb").read_bytes()) > len(first)
    assert main(["volume", str(files["nearest"]), "other.vdb"]) == 3

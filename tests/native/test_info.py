"""The command `pandis info`: what it says of each kind of file, and of one that is damaged."""

import json
import struct

import pytest
from test_header import resealed, section

from pandis.__main__ import main
from pandis.runtime.field.files import read_contents, read_provenance
from pandis.runtime.info import describe, facts

#: What is said of a file of the fixture, by its name.
SAID = {
    "exact": "exact: a mesh of ",
    "compact": " faces, its vertices on a lattice of ",
    "spline": "spline: two banded lattices of ",
    "tricubic": "tricubic: ",
    "trilinear": "trilinear: ",
    "network": "network: ",
    "gradient": "distance, with its own gradient",
    "torus": "closed form: a torus",
}


@pytest.mark.parametrize("name", SAID)
def test_every_kind_of_file_is_told(files, name):
    found = facts(files[name])
    lines = describe(found)
    assert SAID[name] in lines
    assert found["bytes"] == files[name].stat().st_size
    assert found["microseconds"] > 0
    grid = name == "trilinear"
    assert ("force and normal, only inside" in lines) == bool(found["proxy"]) == grid
    assert found["faces"] == (name == "exact")
    assert max(found["size"]) == pytest.approx(found["longest"], rel=0.02)
    assert found["provenance"] == read_provenance(files[name])
    json.dumps(found)


def test_a_compact_file_has_as_many_faces_as_the_mesh(files):
    """Each block holds one face to sixty-four."""
    exact, compact = (facts(files[name])["made_of"] for name in ("exact", "compact"))
    faces = exact.rpartition(" and ")[2].split()[0]
    assert compact.startswith(f"a mesh of {faces} faces")


def test_a_damaged_file_does_not_keep_the_others_from_being_told(files, tmp_path, capsys):
    damaged = tmp_path / "damaged.pandis"
    data = bytearray(files["torus"].read_bytes())
    data[-20] ^= 1
    damaged.write_bytes(data)
    nowhere = str(tmp_path / "nowhere.pandis")
    assert main(["info", str(damaged), nowhere, str(files["torus"])]) == 3
    said = capsys.readouterr()
    assert "closed form: a torus" in said.out
    for path in (str(damaged), nowhere):
        assert f"error: {path}: " in said.err
    assert main(["info", "--json", str(files["torus"]), str(files["spline"])]) == 0
    kinds = [found["kind"] for found in json.loads(capsys.readouterr().out)]
    assert kinds == ["closed form", "spline"]


def test_a_file_that_says_neither_where_it_lies_nor_where_it_is_from(files, tmp_path):
    data = files["spline"].read_bytes()
    for name in (b"SAFE", b"PROV"):  # the table names something that readers do not know
        at = data.index(name, 256)
        data = resealed(data, at, "<4s", b"NONE" if name == b"SAFE" else b"OTHR")
    path = tmp_path / "bare.pandis"
    path.write_bytes(data)
    found = facts(path)
    assert (found["size"], found["provenance"]) == (None, None)
    assert "along its longest side" in describe(found)
    assert "the file does not state it" in describe(found)
    assert set(read_contents(path).sections) >= {"NONE", "OTHR"}
    assert section(data, b"NONE") > 256


@pytest.mark.parametrize(
    ("said", "told_as"),
    [
        (b"{}", "the file does not state it"),
        (b'{"options": [], "wildcards": {"name": 3}, "code": {"digest": null}}', "names no stage"),
        (b'{"wildcards": {"mesh": "ball"}, "options": {"field": "exact"}}', "field exact of mesh"),
        (b"[1, 2]", None),
        (b"{", None),
        (b'{"a": "\xff"}', None),
    ],
)
def test_a_provenance_that_somebody_else_wrote(files, tmp_path, capsys, said, told_as):
    data = bytearray(files["torus"].read_bytes())
    at, room = data.index(b"PROV", 256), 80
    data = data[: section(data, b"PROV")] + said.ljust(room)  # the last section
    struct.pack_into("<Q", data, 16, len(data))
    path = tmp_path / "other.pandis"
    path.write_bytes(resealed(data, at + 16, "<Q", room))
    assert main(["info", str(path)]) == (0 if told_as else 3)
    printed = capsys.readouterr()
    refused = f"error: {path}: its provenance is not "
    assert (told_as in printed.out) if told_as else (refused in printed.err)


def test_a_section_may_have_any_name(files, tmp_path):
    data = files["spline"].read_bytes()
    path = tmp_path / "odd.pandis"
    path.write_bytes(resealed(data, data.index(b"SAFE", 256), "<4s", b"\xff\x00A "))
    assert facts(path)["size"] is None

"""The counter that readers are held against is right itself, on files whose meshes are known."""

import numpy as np
import pytest

import counter
from cases import CASES, Reads, Refuses, case, mutations
from casework import base


@pytest.mark.parametrize("each", CASES, ids=[each.name for each in CASES])
def test_counts_as_stated(each, tmp_path):
    path, answers = each.write(tmp_path), (each.right, each.otherwise)
    answer = next((answer for answer in answers if isinstance(answer, Reads)), None)
    if Refuses in map(type, answers):
        try:
            found = counter.count(path)
        except counter.Refused:
            return
    else:
        found = counter.count(path)
    assert answer, f"counted {found}"
    assert not answer.differs(found.triangles, found.volume, found.low, found.high), found


def test_cases_have_names_of_their_own():
    assert len({each.name for each in CASES}) == len(CASES) >= 60


@pytest.mark.parametrize(("points", "faces", "volume"), [
    (*base.box(), 6.0),
    (base.TETRA, base.TETRA_FACES, 1 / 6),
    (*base.sphere(3.0, (5, 6, 7), rounds=0), 4 / 3 * 27),
])  # fmt: skip
@pytest.mark.parametrize("form", ["obj", "off", "stl", "ply"])
def test_volumes_are_those_of_closed_forms(points, faces, volume, form, tmp_path):
    path = tmp_path / f"a.{form}"
    path.write_bytes(getattr(base, form)(points, faces))
    assert counter.count(path).volume == pytest.approx(volume)
    path.write_bytes(getattr(base, form)(points, faces[:, ::-1]))
    assert counter.count(path).volume == pytest.approx(-volume)


def test_spheres_come_near_the_ball():
    volumes = [base.reads(*base.sphere(1.0, rounds=rounds)).volume for rounds in (1, 2, 3, 4)]
    gaps = 4 / 3 * np.pi - np.array(volumes)
    assert (gaps > 0).all()
    assert gaps[:-1] / gaps[1:] == pytest.approx(4, rel=0.2)


def test_instances_and_units_are_named(tmp_path):
    assert counter.count(case("glb-instances").write(tmp_path)).instances == 3
    assert counter.count(case("3mf-unit-inch").write(tmp_path)).unit == "inch"


def test_words_of_a_message():
    words = Refuses(("line 2", "12", "1,5"))
    assert words.lacks("Line 2: '1,5' of 12") == []
    assert words.lacks("line 21: '1,5' of 112") == ["line 2", "12"]


@pytest.mark.parametrize("name", ["obj-quads", "off-colours", "stl-named", "stl-binary-plain",
                                  "ply-text", "ply-big", "glb-sparse", "glb-nested",
                                  "gltf-embedded", "3mf-same-id"])  # fmt: skip
def test_what_is_mutated_is_counted_or_refused(name, tmp_path):
    whole, rng, refused = case(name), np.random.default_rng(3), 0
    first, data = next(iter(whole.files.items()))
    changed = list(mutations(data, first.split(".")[-1], rng, 30))
    assert len({*changed}) > 20
    for each in changed:
        (tmp_path / first).write_bytes(each)
        try:
            found = counter.count(tmp_path / first)
        except counter.Refused:
            refused += 1
        else:
            assert found.triangles > 0
            assert np.isfinite([found.low, found.high]).all()
    assert 2 < refused < 30

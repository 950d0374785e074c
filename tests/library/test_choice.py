"""`fields: auto`: the cheapest field that meets a budget, and nothing built beyond it."""

import numpy as np
import pytest

from pandis import choice
from pandis.choice import Chooser, QueryTimes
from pandis.config import ExactRecipe, SampleOptions
from pandis.distance import MeshDistance, ShapeDistance
from pandis.errors import PandisError
from pandis.fields.registry import open_fields
from pandis.forces import penalty_force
from pandis.frame import Frame
from pandis.mesh.shapes import SHAPES
from pandis.sampling import Surface, held_out
from pandis.stage import silent_progress
from support import ROOT, artifact

TABLE = ROOT / "config/query-times.csv"
SAMPLES = SampleOptions(
    surface=2000, offsets=2000, shallow=4000, penetration=4000, bent=2000, core=500, box=500,
    held_out=1000,
)  # fmt: skip


def shape(name, mesh_only=False, **size):
    """Return a mesh artifact, its engine and its surface."""
    vertices, faces = SHAPES[name].tessellation(**size)
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    attributes = {"shape": None if mesh_only else name, "frame": frame.attributes()}
    mesh = artifact("mesh", {"vertices": vertices, "faces": faces}, attributes)
    if mesh_only:
        engine = MeshDistance(frame.to_unit(vertices), faces)
        return mesh, engine, Surface(engine.vertices, engine.faces)
    engine = ShapeDistance(SHAPES[name], frame)
    return mesh, engine, Surface(frame.to_unit(vertices), faces, engine)


TORUS = shape("torus", mesh_only=True)


def choose(found, tmp_path, table=TABLE, **budget):
    recipe = ExactRecipe(width=48, depth=2, steps=150, batch=1024, base=8).model_dump()
    options = {
        "budget": {"force_error": None, "query_time": None, "bytes": None} | budget,
        "band": (0.045, 0.02),
        "seed": 3,
        "samples": SAMPLES.model_dump(),
        "recipe": recipe | {"recipe": "pandis-exact"},
    }
    where = tmp_path / "c.pt", silent_progress, lambda text: None
    arrays, attributes, finish = Chooser(*found, options, QueryTimes(table), *where).choose()
    finish()
    frame = {"frame": found[0].attributes["frame"]}
    return artifact("choice", arrays, attributes | frame)


def error_of(held, found, seed=99):
    """Return the force error of what was chosen, on points that the choice has not seen."""
    (field,) = open_fields(["auto"], found[0], [held])
    assert field.name == "auto"
    points, *exact = held_out(found[2], found[1], seed)
    force = penalty_force(*field.answer(points)) - penalty_force(*exact)
    return np.linalg.norm(force, axis=1).mean()


@pytest.fixture
def untrained(monkeypatch):
    def trained(*arguments):
        raise AssertionError("a network was trained")

    monkeypatch.setattr(choice, "train", trained)


@pytest.mark.usefixtures("untrained")
def test_a_sphere_needs_nothing(tmp_path):
    found = shape("sphere")
    held = choose(found, tmp_path, force_error=1e-6, bytes=1000, query_time=1e-3)
    assert held.attributes["choice"]["field"] == "exact"
    assert held.attributes["choice"]["bytes"] == 0
    assert held.attributes["considered"] == []
    assert error_of(held, found) == 0


@pytest.mark.usefixtures("untrained")
def test_without_other_limits_the_mesh_itself_is_the_field(tmp_path):
    held = choose(TORUS, tmp_path, force_error=1e-3)
    assert held.attributes["choice"]["field"] == "exact"
    assert error_of(held, TORUS) == 0


@pytest.mark.usefixtures("untrained")
@pytest.mark.parametrize("wanted", [2e-3, 8e-4])
def test_a_smooth_part_needs_a_coarse_grid(tmp_path, wanted):
    held = choose(TORUS, tmp_path, force_error=wanted, bytes=300_000)
    made = held.attributes["choice"]
    kind, _, size = made["field"].rpartition("-")
    assert kind in choice.KINDS
    assert made["bytes"] <= 300_000
    assert made["held_out_error"] <= wanted
    assert error_of(held, TORUS) <= 1.1 * wanted
    assert held.attributes["considered"][0]["field"] == "exact"
    # the next coarser one of this kind would not do
    coarser = choice.SIZES[choice.SIZES.index(int(size)) - 1]
    again = Chooser(*TORUS, {"budget": {}, "band": (0.045, 0.02), "seed": 3}, None, None,
                    silent_progress, print)  # fmt: skip
    assert again._sizing(kind, force_error=wanted).measure(coarser) > wanted


@pytest.mark.usefixtures("untrained")
def test_time_counts(tmp_path):
    table = tmp_path / "times.csv"
    rows = ["kind,size,microseconds", "exact,1000,20", "exact,100000,40", "spline,800000,60"]
    rows += [f"{kind},64,{30 if kind == 'tricubic' else 50}" for kind in choice.KINDS]
    table.write_text("\n".join([*rows, "network,64,500"]) + "\n")
    held = choose(TORUS, tmp_path, table, force_error=2e-3, query_time=31e-6)
    assert held.attributes["choice"]["field"].startswith("tricubic-")
    assert held.attributes["choice"]["query_time"] == pytest.approx(30e-6)
    assert "µs" in held.attributes["considered"][0]["why"]
    assert QueryTimes(table).seconds("exact", 10_000) == pytest.approx(np.sqrt(20 * 40) * 1e-6)
    with pytest.raises(PandisError, match=r"no query times of 'kim'.*calibrate"):
        QueryTimes(table).seconds("kim", 3)


def test_a_network_is_the_last_resort(tmp_path, monkeypatch):
    monkeypatch.setattr(choice, "SIZES", (16,))
    monkeypatch.setattr(choice, "SPLINE_BYTES", (400_000,))
    held = choose(TORUS, tmp_path, force_error=2e-3, bytes=60_000)
    made = held.attributes["choice"]
    assert made["field"] == "pandis-exact"
    assert made["bytes"] == sum(a.nbytes for k, a in held.arrays.items() if k != "curve")
    assert error_of(held, TORUS) <= 1.1 * 2e-3
    assert [c["field"] for c in held.attributes["considered"]][-1] == "spline"
    assert not list(tmp_path.glob("*.pt"))


@pytest.mark.usefixtures("untrained")
def test_it_says_what_is_missing_where_nothing_will_do(tmp_path):
    with pytest.raises(
        PandisError, match=r"no field meets the budget.*exact: .* bytes at the least; .*spline"
    ):
        choose(TORUS, tmp_path, force_error=1e-9, bytes=500)


@pytest.mark.parametrize(
    "text", ["", "kind,size\nexact,3\n", "kind,size,microseconds\nexact,a,2\n"]
)
def test_a_damaged_table_is_an_error(tmp_path, text):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(PandisError, match="calibrate"):
        QueryTimes(path).seconds("exact", 1)


def test_the_table_that_comes_along_knows_every_kind():
    times = QueryTimes(TABLE)
    for kind in ("exact", "spline", "network", *choice.KINDS):
        assert 1e-8 < times.seconds(kind, 64) < 1e-3

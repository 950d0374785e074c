"""`fields: auto`: the cheapest field that keeps what it promises, and nothing built beyond it."""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.base.physical import Scale
from pandis.base.progress import Context
from pandis.pipeline.geometry.measure import draw_contacts, promise
from pandis.pipeline.geometry.points import _CHOOSING, _PROMISING, Points
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.judge import choice
from pandis.pipeline.judge.choice import Chooser
from pandis.pipeline.kinds.grid.search import GridMaker
from pandis.pipeline.kinds.grid.spec import TRIED
from pandis.pipeline.kinds.native import export_native, native_bytes
from pandis.pipeline.kinds.opening import open_fields
from pandis.pipeline.kinds.spline.search import SplineMaker
from pandis.pipeline.run.ask.catalogue import KIND_OF
from pandis.pipeline.run.ask.kinds import KINDS
from pandis.pipeline.run.ask.options import SampleOptions, StressOptions
from pandis.pipeline.run.ask.recipes import ExactRecipe
from pandis.pipeline.run.ask.tasks import ChooseTask
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.query_times import QueryTimes
from pandis.runtime.field import NativeField
from shapes import Shape, open_shape
from support import ROOT, artifact

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

TABLE = ROOT / "config/query-times.csv"
SAMPLES = SampleOptions(
    surface=2000, offsets=2000, shallow=4000, penetration=4000, bent=2000, core=500, box=500,
    held_out=1000,
)  # fmt: skip
SCALE = Scale(0.1, 400.0)
BUDGET = {"force_error": None, "tail": None, "missed": 0.005, "query_time": None, "bytes": None}


def shape(name, mesh_only=False, **size):
    """Return the shape of a closed form, or of its tessellation alone."""
    vertices, faces = SHAPES[name].tessellation(**size)
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    attributes = {"shape": None if mesh_only else name, **frame.attributes()}
    mesh = artifact("mesh", {"vertices": vertices, "faces": faces}, attributes)
    return Shape(mesh)


TORUS = shape("torus", mesh_only=True)


def chooser(found, tmp_path, table=TABLE, log=lambda text: None, points=None, **budget):
    recipe = ExactRecipe(width=48, depth=2, steps=150, batch=1024, base=8)
    options = ChooseTask(
        budget=BUDGET | budget,
        band=(0.045, 0.02),
        seed=3,
        samples=SAMPLES,
        name="pandis-exact",
        recipe=recipe,
        stress=StressOptions(ticks=2000, loops=5),
        weight_bits=32,
    )
    points = points or Points(found.body, SCALE, 3)
    context = Context(tmp_path / "c.pt", silent_progress, log)
    return Chooser(points, options, QueryTimes(table), context=context)


def choose(found, tmp_path, table=TABLE, **budget):
    arrays, attributes, finish = chooser(found, tmp_path, table, **budget).choose()
    finish()
    frame = Frame.of(found.mesh).attributes()
    return artifact("choice", arrays, attributes | frame)


def figures_of(held, found, seed=99):
    """Return what a chosen field errs by, on 20,000 points that the choice has not seen."""
    (field,) = open_fields(["auto"], found.mesh, [held])
    assert field.name == "auto"
    rng = np.random.default_rng([seed, 1])
    contacts = draw_contacts(found.body, SCALE, 20_000, rng=rng)
    return promise(lambda points: penalty_force(*field.answer(points)), contacts)[0]


def without(monkeypatch, *names):
    """Let a choice pass over some kinds."""
    left = {name: kind for name, kind in choice.KINDS.items() if name not in names}
    monkeypatch.setattr(choice, "KINDS", left)


@pytest.fixture
def untrained(monkeypatch):
    def trained(*arguments, **options):
        raise AssertionError("a network was trained")

    monkeypatch.setattr("pandis.pipeline.kinds.network.choice.narrowest", trained)


@pytest.fixture
def without_compact(monkeypatch):
    """What comes after the compact mesh is looked at alone."""
    without(monkeypatch, "compact")


@pytest.mark.full
@pytest.mark.usefixtures("untrained")
def test_a_mesh_too_large_for_its_budget_is_packed(tmp_path):
    exact = TORUS.engine.tree_bytes
    held = choose(TORUS, tmp_path, force_error="1 %", bytes=exact // 8)
    made, limits = held.attributes["choice"], held.attributes["limits"]
    assert made["field"] == "compact-auto"
    assert [one["field"] for one in held.attributes["considered"]] == ["exact"]
    (field,) = open_fields(["auto"], TORUS.mesh, [held])
    assert made["bytes"] == field.bytes <= exact // 8
    fresh = figures_of(held, TORUS)
    assert fresh["mean"] <= limits["mean"]
    assert fresh["p99"] <= limits["tail"]
    assert fresh["missing"] == 0


@pytest.mark.usefixtures("untrained")
def test_a_sphere_needs_nothing(tmp_path):
    found = shape("sphere")
    held = choose(found, tmp_path, force_error=1e-6, bytes=1000, query_time=1e-3)
    assert held.attributes["choice"]["field"] == "exact"
    assert held.attributes["choice"]["bytes"] == 0
    assert held.attributes["considered"] == []
    assert figures_of(held, found)["mean"] == 0


@pytest.mark.usefixtures("untrained")
def test_without_other_limits_the_mesh_itself_is_the_field_and_that_is_said(tmp_path):
    lines = []
    made = chooser(TORUS, tmp_path, log=lines.append, force_error="20 mN").choose()
    assert made[1]["choice"]["field"] == "exact"
    said = "a budget without bytes and query_time takes the exact field: it has no error"
    assert any(said in line for line in lines)


@pytest.mark.usefixtures("untrained", "without_compact")
@pytest.mark.parametrize("wanted", ["40 mN", pytest.param("4 %", marks=pytest.mark.full)])
def test_a_smooth_part_needs_a_coarse_grid(tmp_path, wanted):
    held = choose(TORUS, tmp_path, force_error=wanted, bytes=2_000_000)
    made, limits = held.attributes["choice"], held.attributes["limits"]
    kind, _, size = made["field"].rpartition("-")
    assert kind in TRIED
    assert made["bytes"] <= 2_000_000
    fresh = figures_of(held, TORUS)
    assert fresh["mean"] <= limits["mean"]
    assert fresh["p99"] <= limits["tail"]
    assert fresh["missing"] <= limits["missed"]
    assert held.attributes["considered"][0]["field"] == "exact"
    # the next coarser one of this kind would not do
    coarser = GridMaker.sizes[GridMaker.sizes.index(int(size)) - 1]
    again = chooser(TORUS, tmp_path, force_error=wanted, bytes=2_000_000)
    maker = GridMaker(kind, again.points, again.options.band, progress=silent_progress)
    assert again.measured(maker, coarser)[0].why


@pytest.mark.usefixtures("untrained")
def test_time_counts(tmp_path):
    """With a table that lacks compact meshes none is taken, and the reason is given."""
    table = tmp_path / "times.csv"
    rows = ["kind,size,microseconds", "exact,1000,20", "exact,100000,40", "spline,800000,60"]
    rows += [f"{kind},64,{30 if kind == 'tricubic' else 50}" for kind in TRIED]
    table.write_text("\n".join([*rows, "network,64,500"]) + "\n")
    held = choose(TORUS, tmp_path, table, force_error=2e-3, query_time=31e-6)
    assert held.attributes["choice"]["field"].startswith("tricubic-")
    assert held.attributes["choice"]["query_time"] == pytest.approx(30e-6)
    assert "µs" in held.attributes["considered"][0]["why"]
    assert held.attributes["considered"][1]["field"] == "compact-auto"
    assert "no query times of compact meshes" in held.attributes["considered"][1]["why"]
    times = QueryTimes(table)
    assert times.seconds("exact", 10_000) == pytest.approx(np.sqrt(20 * 40) * 1e-6)
    # beyond the table: on along its last step; a network at least in proportion to its weights
    assert times.seconds("exact", 1e7) == pytest.approx(80e-6)
    assert times.seconds("network", 64, layers=8) >= 2 * 500e-6
    assert times.seconds("network", 128) >= 3.5 * 500e-6
    assert times.seconds("network", 64, layers=2) == pytest.approx(500e-6)
    with pytest.raises(PandisError, match=r"no query times of 'kim'.*calibrate"):
        times.seconds("kim", 3)


@pytest.mark.usefixtures("without_compact")
def test_a_network_is_the_last_resort(tmp_path, monkeypatch):
    monkeypatch.setattr("pandis.pipeline.kinds.grid.choice.TRIED", ("nearest",))
    monkeypatch.setattr(GridMaker, "sizes", (16,))
    monkeypatch.setattr(SplineMaker, "sizes", (400_000,))
    monkeypatch.setattr(Chooser, "proved", lambda self, field, measured: measured)
    lines, wanted = [], {"force_error": 2e-3, "tail": 0.05, "bytes": 60_000}
    made = chooser(TORUS, tmp_path, log=lines.append, **wanted)
    arrays, attributes, finish = made.choose()
    finish()
    chosen = attributes["choice"]
    assert chosen["field"] == "pandis-exact"
    held = artifact("choice", arrays, attributes | Frame.of(TORUS.mesh).attributes())
    (network,) = open_fields(["auto"], TORUS.mesh, [held])
    file = native_bytes(network, {})
    assert chosen["bytes"] == NativeField(file).bytes <= wanted["bytes"]
    held = artifact("choice", arrays, attributes | Frame.of(TORUS.mesh).attributes())
    assert figures_of(held, TORUS)["mean"] <= 2e-3
    assert [c["field"] for c in attributes["considered"]][-1] == "spline"
    assert not list(tmp_path.glob("*.pt"))
    # what the others can reach is said before anything is trained
    said = next(k for k, line in enumerate(lines) if line.startswith("networks are tried next"))
    assert said < next(k for k, line in enumerate(lines) if line.startswith("network of"))


@pytest.mark.usefixtures("untrained", "without_compact")
def test_it_names_the_nearest_where_nothing_will_do(tmp_path, monkeypatch):
    monkeypatch.setattr(GridMaker, "sizes", (16, 24))
    without(monkeypatch, "network")
    said = r"no field meets the budget of .* mN .* on average.*The nearest is .* which has a force "
    said += "error of .*mN"
    with pytest.raises(PandisError, match=said):
        choose(TORUS, tmp_path, force_error=1e-5, bytes=30_000)
    with pytest.raises(PandisError, match="exact: .* bytes at the least; .*spline"):
        choose(TORUS, tmp_path, force_error=1e-3, bytes=500)


@pytest.mark.full
@pytest.mark.usefixtures("untrained", "without_compact")
def test_what_fails_the_stress_suite_or_its_export_is_not_chosen(tmp_path, monkeypatch):
    first = choose(TORUS, tmp_path, force_error="40 mN", bytes=2_000_000).attributes["choice"]
    proved, seen = Chooser.proved, []

    def once(self, field, measured):
        found = proved(self, field, measured)
        if not found.why and not seen:
            seen.append(field)
            return measured._replace(why="cannot be exported: by this test", excess=1.0)
        return found

    monkeypatch.setattr(Chooser, "proved", once)
    second = choose(TORUS, tmp_path, force_error="40 mN", bytes=2_000_000).attributes["choice"]
    assert second["bytes"] >= first["bytes"]
    assert second["field"] != first["field"]


@pytest.mark.usefixtures("untrained", "without_compact")
def test_the_file_is_what_must_keep_to_the_budget(tmp_path, monkeypatch):
    """A field whose file answers something else is not chosen, however good the field is."""
    written = []

    def forceless(field, *arguments, **options):
        written.append(field.name)
        field.values = np.full_like(field.values, 0.01)
        return export_native(field, *arguments, **options)

    without(monkeypatch, "spline", "network")
    monkeypatch.setattr("pandis.pipeline.kinds.grid.choice.TRIED", ("trilinear-normal",))
    wanted = {"force_error": "40 mN", "bytes": 2_000_000}
    assert choose(TORUS, tmp_path, **wanted).attributes["choice"]["field"].startswith("trilinear")
    monkeypatch.setattr(choice, "export_native", forceless)
    with pytest.raises(PandisError, match="no field meets the budget.*trilinear-normal"):
        choose(TORUS, tmp_path, **wanted)
    assert written


@pytest.mark.usefixtures("untrained")
@pytest.mark.parametrize("name", ["plate-0.6", "finned-ball"])
def test_a_field_without_force_is_never_sold(tmp_path, name):
    """What the first round sold: a grid of no force, its budget called met."""
    with pytest.raises(PandisError, match="no field meets the budget"):
        choose(open_shape(name), tmp_path, force_error=1e-3, bytes=100)
    found = open_shape(name)
    attributes = choose(found, tmp_path, force_error=1e-3).attributes
    assert attributes["choice"]["field"] == "exact"


def test_what_is_too_thin_to_be_judged_is_not_sold(tmp_path):
    """An edge that tapers to nothing: on more than half a percent nobody could tell."""
    said = "of the surface is thinner than 0.02 mm under the device .* make device.size larger"
    with pytest.raises(PandisError, match=said):
        choose(open_shape("blade"), tmp_path, force_error=1e-3)


def test_a_choice_that_passes_a_control_is_blind(tmp_path):
    loose = chooser(TORUS, tmp_path, force_error=1.0)
    loose.limits = loose.limits._replace(missed=0.9)
    with pytest.raises(PandisError, match="the choice by budget is blind.*control-gap"):
        loose.choose()


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
    forms = [form for kind in KINDS.values() if kind.chosen for form in kind.forms]
    for form in TRIED + tuple(form for form in forms if KIND_OF[form].name != "grid"):
        assert 1e-8 < times.seconds(form, 64) < 1e-3


def test_every_stream_of_random_numbers_is_another_one():
    """A trailing zero changes no stream of NumPy's: [s, 11] and [s, 11, 0] once coincided."""
    same = [np.random.default_rng(key).random() for key in ([5, 11], [5, 11, 0])]
    assert same[0] == same[1]
    own = {np.random.default_rng([5, *key]).random() for key in (_CHOOSING, _PROMISING)}
    shards = {
        np.random.default_rng([5, stratum, shard]).random()
        for stratum in range(20)
        for shard in range(100)
    }
    assert len(own) == 2
    assert not own & (shards | set(same))

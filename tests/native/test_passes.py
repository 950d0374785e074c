"""Nothing lets a hand through, by an oracle that would see it: passes are found where they are."""

from types import SimpleNamespace

import numpy as np
import pytest

from pandis.base.frame import UNIT, UNIT_SIDE
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import Box
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.pipeline.judge.servo.passes import ABOVE, MARGIN, Oracle, draw, free_starts, judge, run
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.contact import Feel, Material
from pandis.runtime.field import NativeField
from support import artifact

SIZE, THICK = 0.1, 0.002


@pytest.fixture(scope="module")
def plate():
    """Return fields of a plate of 100 x 100 x 2 mm by kind, and the oracle; metres."""
    half = np.array([0.9, 0.9, 0.9 * THICK / SIZE])
    vertices, faces = Box(tuple(half)).tessellation(cuts=4)
    frame = UNIT
    mesh = artifact("mesh", {"vertices": vertices, "faces": faces},
                    {**frame.attributes(), "shape": None})  # fmt: skip
    body = Body.open(mesh)
    arrays, record = build_compact(body, 16, 0, log=lambda text: None)
    packed = artifact("compact", arrays, record.attributes() | frame.attributes())
    made = {
        "exact": ExactField("exact", body),
        "compact": CompactField("compact-16", packed),
    }
    fields = {name: NativeField(native_bytes(field, {})) for name, field in made.items()}
    return fields, Oracle(vertices * SIZE / UNIT_SIDE, faces)


def presses_on(count, device, seed=0, thick=THICK, above=ABOVE):
    """Return presses on both sides of a plate, away from its rim."""
    rng = np.random.default_rng(seed)
    side = rng.choice([-1.0, 1.0], count)
    feet = np.column_stack([*rng.uniform(-0.03, 0.03, (2, count)), side * thick / 2])
    outward = np.column_stack([np.zeros((count, 2)), side])
    spec = DEVICES[device]
    stiffness = min(spec.stiffness, 1000.0)
    return draw((feet, outward), spec, stiffness, slant=0.4, rng=rng, above=above)


@pytest.mark.slow
@pytest.mark.parametrize("device", ["touch", "omega-3"])
def test_a_plate_lets_no_proxy_through_and_every_penalty_force(plate, device):
    fields, oracle = plate
    spec, presses = DEVICES[device], presses_on(12, device)
    stiffness = min(spec.stiffness, 1000.0)
    for name, field in fields.items():
        for material in (Material(), Material(0.5, 0.4, 0.5, 0.1)):
            runs = run(
                field,
                spec,
                SIZE,
                stiffness=stiffness,
                presses=presses,
                feel=Feel(materials=(material,)),
            )
            judged = judge(runs, oracle, 2e-6)
            assert judged.passed == 0, (name, judged)
            assert judged.presses == 12
            assert judged.ended == 0
    penalty = judge(
        run(fields["exact"], spec, SIZE, stiffness=stiffness, presses=presses), oracle, 0.0
    )
    assert penalty.passed == 12


def test_a_press_that_begins_where_only_the_field_is_inside_does_not_pass(plate):
    """The plate that is judged is 0.4 mm thinner than the field's: presses begin in between."""
    fields, oracle = plate
    thin = Oracle(oracle.vertices * [1, 1, 0.8], oracle.faces)
    spec = DEVICES["omega-3"]
    presses = presses_on(8, "omega-3", thick=0.8 * THICK, above=1e-4)
    assert len(free_starts(presses, thin, 1e-4)) == 8
    assert not free_starts(presses, oracle, 1e-4)
    for field in fields.values():
        runs = list(run(field, spec, SIZE, stiffness=1000.0, presses=presses, feel=Feel()))
        judged = judge(runs, thin, 0.0)
        assert (judged.presses, judged.passed) == (8, 0)
        assert judged.deepest < 0  # it has stayed where it began, and that is outside
        assert min(session.strongest for session, _ in runs) > 11.0  # of 12 N


def test_a_force_that_a_proxy_holds_is_what_the_hand_gives(plate):
    fields, _ = plate
    spec, presses = DEVICES["touch"], presses_on(4, "touch")
    for session, proxy in run(
        fields["exact"], spec, SIZE, stiffness=400.0, presses=presses, feel=Feel()
    ):
        assert session.strongest > 3.0  # of 3.3 N; a penalty force gives 0.4 at most
        assert np.abs(proxy[:, 2]).min() > THICK / 2 - 1e-9


def path_of(*corners, steps=400):
    """Return a run whose proxy goes along corners, as fast as a hand does."""
    corners = np.array(corners)
    at = np.linspace(0, len(corners) - 1, steps)
    path = np.stack([np.interp(at, np.arange(len(corners)), c) for c in corners.T], axis=1)
    return SimpleNamespace(cause=0, position=path[-1:], force=path), path


def test_the_oracle_sees_a_pass_wherever_it_is(plate):
    _, oracle = plate
    over = THICK / 2 + 1e-6
    kept = path_of([0, 0, 0.01], [0, 0, over], [0.03, 0, over], [0, 0, 0.01])
    assert judge([kept], oracle, 0.0).passed == 0
    session, path = kept
    deep = path.copy()
    deep[200, 2] = THICK / 2 - 2 * MARGIN  # one tick of four hundred
    assert judge([(session, deep)], oracle, 0.0).deep == 1
    assert judge([(session, deep)], oracle, 2 * MARGIN).passed == 0
    through = path.copy()
    through[200:300, 2] = -over  # from one side to the other between two ticks, never inside
    assert judge([(session, through)], oracle, 0.0).crossed == 1
    caught = SimpleNamespace(cause=0, position=np.array([[0, 0, -0.01]]))
    assert judge([(caught, path)], oracle, 0.0).around == 1


def test_a_way_around_the_rim_is_no_pass(plate):
    _, oracle = plate
    rim = SIZE / 2 + 3e-5
    around = path_of([0.048, 0, 0.002], [rim, 0, 0.001], [rim, 0, -0.001], [0.048, 0, -0.002])
    assert judge([around], oracle, 0.0).passed == 0


def test_a_narrow_way_over_a_ridge_is_no_pass_and_one_through_it_is():
    gap, ridge = 3e-4, (2e-4, 0.02, 3e-3)

    def oracle(height):
        """Return that of a slit between two blocks, with a ridge so high on the lower one."""
        wall, away = (0.02, 0.02, 0.004), (gap + 0.004) / 2
        blocks = [(wall, away), (wall, -away), (ridge, height - (gap + ridge[2]) / 2)]
        parts = [(Box(tuple(np.array(size) / 2)).tessellation(cuts=3), z) for size, z in blocks]
        vertices = [corners + [0, 0, z] for (corners, _), z in parts]
        starts = np.cumsum([0, *(len(v) for v in vertices[:-1])])
        faces = [f + start for ((_, f), _), start in zip(parts, starts, strict=True)]
        return Oracle(np.concatenate(vertices), np.concatenate(faces))

    low = 1e-5 - gap / 2
    over = path_of([-2e-3, 0, low], [-2e-3, 0, low], [2e-3, 0, low], [2e-3, 0, low], steps=4)
    assert judge([over], oracle(gap / 2), 0.0).passed == 0
    assert judge([over], oracle(gap), 0.0).crossed == 1

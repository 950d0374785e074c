"""A simulation that moves objects at its own rate, and a hand that feels them at a kilohertz."""

import re
import threading
import time

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.bridges import mujoco as plugin
from pandis.engine.compiler import find_compiler
from pandis.pipeline.judge.servo.devices import DEVICES
from pandis.runtime.contact import TouchedScene
from pandis.runtime.contact.surfaces import Material
from pandis.runtime.device import DONE, Order, Simulated, run_simulated
from pandis.runtime.samples import sample_bytes
from support import ROOT

mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: pip install mujoco-core")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler here")

#: Side of the object (m), its mass (kg), ticks until the whole force is given, and then.
HALF, MASS, RAMP, TICKS = 0.03, 0.4, 500, 700
TOUCH = DEVICES["touch"]


@pytest.fixture(scope="module", autouse=True)
def registered():
    plugin.register()


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    path = tmp_path_factory.mktemp("box") / "box.pandis"
    path.write_bytes(sample_bytes("box", HALF, HALF, HALF))
    return path


def bridge_of(path, joint="<freejoint/>", step=0.005, more="", euler="0 0 0", **options):
    """Return a bridge to a box that floats, or is held as a joint says, and its model."""
    from pandis.bridges.mujoco.bridge import Bridge

    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{step}" gravity="0 0 0" integrator="implicitfast"/>
          <compiler inertiafromgeom="false"/>
          <extension><plugin plugin="pandis.sdf"><instance name="b">
            <config key="file" value="{path}"/></instance></plugin></extension>
          <asset><mesh name="b"><plugin instance="b"/></mesh></asset>
          <worldbody><body name="box" euler="{euler}">{joint}
            <inertial pos="0 0 0" mass="{MASS}" diaginertia="2.4e-4 2.4e-4 2.4e-4"/>
            <geom name="box" type="sdf" mesh="b" contype="0" conaffinity="0">
              <plugin instance="b"/></geom></body>{more}</worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Bridge(model, data, **options), model, data


def press(
    bridge, push=(0, 0, -2.0), start=(0, 0, 0.034), ticks=TICKS, order=None, hand=(0, 3.0), **more
):
    """Let a hand press the simulated Touch onto what lies under it."""
    limits = TOUCH.limits(1e-3, 400.0)
    limits.most_damping = 0.0
    rest, force = (
        np.tile(np.array(start, float), (ticks, 1)),
        np.tile([0, 0, -2.0], (ticks, 1)),
    )
    force[:RAMP] = 0
    device = TOUCH.simulated((0, 3.0), delay=0, period=1e-3, wall=400.0)
    order = order or bridge.in_step(ticks, limits, armed=True)
    return run_simulated(device, start, rest, press=force, order=order)


def test_what_the_hand_gets_the_object_gets_the_other_way(box):
    """Linear momentum, of an object that floats: to the last bit of what was sent."""
    bridge, _, data = bridge_of(box)
    session = press(bridge)
    assert session.cause == DONE
    assert session.force[:, 2].max() > 0.5
    bridge.step()  # what was given since the last step
    bridge.step()
    momentum = MASS * data.qvel[:3]
    assert not bridge.dropped.any()
    given = -1e-3 * session.force.sum(axis=0)
    assert momentum == pytest.approx(given, abs=1e-9)
    assert momentum[2] < -0.1


def test_an_object_turns_as_it_is_pushed_beside_its_middle(box):
    """Angular momentum around the origin is the sum of the pushes where the proxy was."""
    bridge, _, data = bridge_of(box, euler="0 0 30")
    session = press(bridge, start=(0.015, 0.008, 0.034), ticks=RAMP + 60)
    pushed = session.force.any(axis=1)
    assert pushed.sum() > 30
    moment = 1e-3 * np.cross(session.proxy[pushed], -session.force[pushed]).sum(axis=0)
    bridge.step()
    bridge.step()
    spin = np.array(data.cvel[1, :3])
    middle = data.xipos[1]
    angular = 2.4e-4 * spin + np.cross(middle, MASS * data.qvel[:3])
    assert np.linalg.norm(moment) > 1e-3
    assert angular == pytest.approx(moment, abs=0.02 * np.linalg.norm(moment))


def test_an_object_that_stands_still_feels_as_it_does_without_a_simulation(box):
    """To the last bit, whatever the rate of the simulation."""
    forces = []
    for step in (0.002, 0.01):
        bridge, _, _ = bridge_of(box, joint="", step=step)
        forces.append(press(bridge).force)
    bridge, _, _ = bridge_of(box, joint="")
    limits = TOUCH.limits(1e-3, 400.0)
    limits.most_damping = 0.0
    alone = TouchedScene(bridge.scene.objects, 0.0, [Material()])
    forces.append(press(None, order=Order(alone, TICKS, limits, armed=True)).force)
    assert forces[0].any()
    assert np.array_equal(forces[0], forces[1])
    assert np.array_equal(forces[0], forces[2])


def test_an_unarmed_hand_moves_nothing(box):
    bridge, _, data = bridge_of(box)
    order = bridge.in_step(TICKS, TOUCH.limits(1e-3, 400.0), armed=False)
    session = press(bridge, order=order)
    assert not session.force.any()
    bridge.step()
    assert not data.qvel.any()


def test_forces_of_others_stay(box):
    """And those of the hand are gone after each step, whoever steps on."""
    bridge, _, data = bridge_of(box)
    data.xfrc_applied[1, 0] = 1e-3
    press(bridge)
    assert data.qvel[2] < -0.1
    assert data.qvel[0] > 1e-4
    assert data.xfrc_applied[1].tolist() == [1e-3, 0, 0, 0, 0, 0]
    assert not data.xfrc_applied[0].any()


def test_each_of_two_objects_gets_what_is_its_own(box, tmp_path):
    """Beside the middle of the workspace; one of them with an origin that MuJoCo has moved."""
    import trimesh

    from pandis.bridges.mujoco.bridge import Bridge

    other, obj = tmp_path / "other.pandis", tmp_path / "other.obj"
    other.write_bytes(sample_bytes("box", HALF, HALF, HALF))
    made = trimesh.creation.box([2 * HALF] * 3)
    made.apply_scale(0.999)
    half = trimesh.creation.box([HALF] * 3)  # more mass on one side moves the centre of mass
    half.apply_translation([0.1 * HALF, 0, 0])
    trimesh.util.concatenate([made, half]).export(obj)
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.005" gravity="0 0 0" integrator="implicitfast"/>
          <extension><plugin plugin="pandis.sdf">
            <instance name="a"><config key="file" value="{box}"/></instance>
            <instance name="b"><config key="file" value="{other}"/></instance></plugin></extension>
          <asset><mesh name="a"><plugin instance="a"/></mesh>
            <mesh name="b" file="{obj}"/></asset>
          <worldbody>
            <body name="a" pos="1 2 3"><freejoint/><geom type="sdf" mesh="a" mass="{MASS}"
              contype="0" conaffinity="0"><plugin instance="a"/></geom></body>
            <body name="b" pos="1.2 2 3"><freejoint/><geom name="b" type="sdf" mesh="b"
              mass="{MASS}" contype="0" conaffinity="0"><plugin instance="b"/></geom></body>
          </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(model.mesh_pos[1]).max() > 1e-4
    bridge = Bridge(model, data, centre=(1.2, 2, 3))
    session = press(bridge)
    assert session.force[:, 2].max() > 0.5
    assert session.proxy[session.force.any(axis=1)][0, 2] == pytest.approx(HALF, abs=1e-5)
    bridge.step()
    bridge.step()
    assert not data.qvel[:6].any()
    given = -1e-3 * session.force.sum(axis=0)
    assert MASS * data.cvel[2, 3:] == pytest.approx(given, abs=0.05 * np.abs(given).max())
    with pytest.raises(PandisError, match="no geom of pandis.sdf is called a"):
        Bridge(model, data, materials={"a": Material()})


SPRING = '<joint type="slide" axis="0 0 1" stiffness="500" damping="1"/>'


@pytest.mark.parametrize("step", [0.002, 0.005])
def test_an_object_on_a_spring_may_push_back(step, box):
    """What it gives is its own: to a guard that does not know of it, energy seems to come up."""
    device = DEVICES["omega-3"]
    limits = device.limits(1e-3, 453.0)
    limits.most_damping = 0.0
    ticks = 2500
    rest = np.tile([0, 0, HALF + 1e-3], (ticks, 1))
    force = np.zeros((ticks, 3))
    force[RAMP:, 2] = -2.0
    force[RAMP + 800 :, 2] = -0.2  # the hand gives way, and the spring lifts it
    made = device.simulated((0, 1.0), delay=0, period=1e-3, wall=453.0)
    bridge, _, _ = bridge_of(box, joint=SPRING, step=step, stiffness=453.0)
    session = run_simulated(
        made, rest[0], rest, press=force, order=bridge.in_step(ticks, limits, armed=True)
    )
    assert session.cause == DONE, session.sentence
    assert session.position[RAMP + 800 :, 2].max() - session.position[RAMP + 790, 2] > 2e-3
    # the hand took more energy than the contact has stored
    way = np.diff(session.position[RAMP + 800 :], axis=0)
    work = (session.force[RAMP + 800 : -1] * way).sum()
    assert work > 2 * 2.0**2 / (2 * 453.0) * 0.5
    assert session.worst > -2.5e-4


def test_what_is_pushed_while_the_simulation_waits_is_no_blow(box):
    """Of two seconds without a step, the object gets no more than a few steps' worth."""
    bridge, model, data = bridge_of(box)
    order = bridge.in_step(TICKS + 2000, TOUCH.limits(1e-3, 400.0), armed=True)
    calls = []

    def stalling():
        calls.append(1)
        if len(calls) < 103:  # some steps after the whole force is given
            bridge.step()

    session = press(bridge, ticks=TICKS + 2000, order=order._replace(between=stalling))
    before = data.qvel[2]
    bridge.step()
    bridge.step()
    assert session.force[-1, 2] > 0.5
    blow = MASS * (before - data.qvel[2])
    assert 0 < blow < 2.5 * 6 * model.opt.timestep
    assert bridge.dropped[2] < -2
    received = -1e-3 * session.force.sum(axis=0) - bridge.dropped
    assert MASS * data.qvel[:3] == pytest.approx(received, abs=1e-9)


def test_two_threads_at_their_own_rates(box):
    """By the clock: the loop never waits for the simulation, and the object gets the whole push."""
    bridge, _, data = bridge_of(box, step=0.004)
    limits = TOUCH.limits(1e-3, 400.0)
    limits.most_damping = 0.0  # the guard's damping is a force on the hand alone
    order = bridge.order(TICKS, limits, armed=True, deadline=0.5, gap=5.0, patience=10.0)
    ended = []
    rest = np.tile([0, 0, 0.034], (TICKS, 1))
    force = np.zeros((TICKS, 3))
    force[RAMP:, 2] = -2
    device = TOUCH.simulated((0, 3.0), delay=0, period=1e-3, wall=400.0)
    thread = threading.Thread(
        target=lambda: ended.append(
            run_simulated(device, rest[0], rest, press=force, order=order, clock=True)
        )
    )
    thread.start()
    begin, steps = time.perf_counter(), 0
    while thread.is_alive():
        if time.perf_counter() - begin >= 0.004 * steps:
            bridge.step()
            steps += 1
    bridge.step()
    bridge.step()
    session = ended[0]
    assert session.force[:, 2].max() > 0.5
    assert steps > 10
    # a busy machine may stop the simulation for more than four of its steps
    received = -1e-3 * session.force.sum(axis=0) - bridge.dropped
    assert MASS * data.qvel[:3] == pytest.approx(received, abs=1e-9)
    assert data.qvel[2] < 0


def test_a_simulation_that_fails_ends_the_run(box):
    bridge, _, _ = bridge_of(box)
    calls = []

    def failing():
        calls.append(1)
        if len(calls) > 110:
            raise FloatingPointError("it exploded")

    order = bridge.in_step(TICKS, TOUCH.limits(1e-3, 400.0), armed=True)._replace(between=failing)
    with pytest.raises(FloatingPointError, match="it exploded"):
        press(bridge, order=order)
    assert len(calls) == 111
    again = press(bridge_of(box)[0])  # nothing is left behind
    assert again.cause == DONE


def test_what_is_wrong_is_said(box):
    from pandis.bridges.mujoco.bridge import Bridge

    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(PandisError, match="no geom of the plugin"):
        Bridge(empty, mujoco.MjData(empty))
    with pytest.raises(PandisError, match="no geom of pandis.sdf is called lid"):
        bridge_of(box, materials={"lid": Material()})
    bridge, _, _ = bridge_of(box, step=0.0033)
    with pytest.raises(PandisError, match="not a whole number of ticks"):
        press(bridge)
    bridge, _, _ = bridge_of(box)
    order = bridge.in_step(10, TOUCH.limits(1e-3, 400.0))
    for wrong in (order, order._replace(between=None, hold=5)):
        with pytest.raises(ValueError, match="use Bridge.order in real time"):
            run_simulated(Simulated(), 0, 0, press=0, order=wrong, clock=True)


def test_a_second_run_begins_anew(box):
    """Where the first one ended, inside, is no place for the next one's proxy."""
    bridge, _, _ = bridge_of(box, joint="")
    first = press(bridge)
    again = press(bridge)
    assert first.force.any()
    assert np.array_equal(first.force, again.force)


def test_the_program_of_the_page_runs(tmp_path, monkeypatch, capsys):
    """As it stands, below the page's first program, whose model it uses."""
    page = (ROOT / "docs/simulators.md").read_text(encoding="utf-8")
    model = re.search(r"```python\n(.*?)```", page, re.S)[1]
    (text,) = re.findall("```python\n([^`]*import Bridge.*?)```", page, re.S)
    path = tmp_path / "results/bunny/export/compact-auto.pandis"
    path.parent.mkdir(parents=True)
    path.write_bytes(sample_bytes("box", 0.3, 0.3, 0.3))
    monkeypatch.chdir(tmp_path)
    known = {}
    exec(model + text, known)
    said = capsys.readouterr().out
    assert "ran to its end" in said
    assert float(re.search(r"largest force: ([\d.]+) N", said)[1]) > 0.5
    assert known["data"].time == pytest.approx(4.0)  # two seconds each


@pytest.mark.parametrize(
    ("joint", "step", "after"),
    [("<freejoint/>", 0.02, 15), ('<joint type="slide" axis="0 0 1"/>', 0.02, 20),
     ("<freejoint/>", 0.002, 2)],
)  # fmt: skip
def test_between_steps_an_object_gives_way_by_its_own_inertia(joint, step, after, box):
    """A tick's push moves it by the next tick, long before the simulation's next step."""
    bridge, model, data = bridge_of(box, joint=joint, step=step)
    ticks = RAMP + 100 + after
    order, seen = bridge.in_step(ticks, TOUCH.limits(1e-3, 400.0), armed=True), []

    def looking():
        bridge.step()
        seen[:] = (
            bridge.scene.lies(0)[1][2],
            data.xpos[1, 2],
            data.qvel[-1 if len(data.qvel) == 1 else 2],
        )

    session = press(bridge, ticks=ticks, order=order._replace(between=looking))
    lay, place, speed = seen  # when the last frame came
    base = lay + after / order.every * (place + speed * model.opt.timestep - lay)
    impulse = 1e-3 * session.force[-after:-1, 2].cumsum()
    given = -1e-3 / MASS * impulse.sum()
    assert given < -1e-6
    assert bridge.scene.lies(0)[1][2] == pytest.approx(base + given, abs=2e-2 * abs(given))

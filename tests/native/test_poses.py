"""Poses that a simulation hands over: no tick brings a step, and neither thread waits."""

import threading

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_scenes import place, room, same_bits, walk

from pandis.base.errors import PandisError
from pandis.runtime.contact import NativeContact, TouchedScene
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed
from pandis.runtime.scene.poses import Poses

DT = 1e-3
STILL = np.zeros((1, 3))


def at(scene, index=0):
    rotation, translation = scene.lies(index)
    return Rotation.from_matrix(rotation), translation


@pytest.fixture
def one(files):
    """Return a scene of one ball that lies somewhere, and its poses."""
    rng = np.random.default_rng(3)
    scene = NativeScene([place(NativeField(files["sphere"]), rng, 0.1)])
    return scene, Poses(scene)


@pytest.mark.parametrize("period", [2e-3, 1e-2])
def test_what_moves_evenly_is_where_it_would_be_in_every_tick(one, period):
    scene, poses = one
    start, velocity = scene.lies(0), np.array([0.3, -0.2, 0.1])
    spin, begun = np.array([1.0, 2.0, -1.5]), Rotation.from_matrix(start[0])
    ticks = round(period / DT)
    for frame in range(50):
        now = frame * period
        turned = Rotation.from_rotvec(now * spin) * begun
        poses.give(turned.as_matrix()[None], (start[1] + now * velocity)[None],
                   velocity[None], spins=spin[None], period=period)  # fmt: skip
        for tick in range(1, ticks + 1):
            assert poses.step(DT) == (tick == 1)
            later = now + tick * DT
            rotation, translation = at(scene)
            assert np.abs(translation - start[1] - later * velocity).max() < 1e-14
            off = (rotation * (Rotation.from_rotvec(later * spin) * begun).inv()).magnitude()
            # between frames it turns along a chord; at their ends it is there
            assert off < (1e-13 if tick == ticks else 0.02 * (period * 2.7) ** 3)


def test_nothing_jumps_however_frames_jump(one):
    scene, poses = one
    rng, period = np.random.default_rng(0), 4e-3
    before, left = at(scene), 0.0
    for tick in range(4000):
        if tick % 3 == 0 and rng.random() < 0.5:  # now early, now late, and often anywhere
            poses.give(Rotation.random(1, random_state=rng.integers(1 << 31)).as_matrix(),
                       rng.normal(size=(1, 3)), rng.normal(size=(1, 3)),
                       spins=rng.normal(size=(1, 3)), period=period)  # fmt: skip
            left = period
        poses.step(DT)
        rotation, translation = at(scene)
        gone, turned = translation - before[1], (rotation * before[0].inv()).magnitude()
        if left <= 0:  # it waits for the next frame
            assert not gone.any()
            assert turned == 0
        assert np.linalg.norm(gone) < 8 * DT / period
        assert turned < 1.7  # of half a turn in four ticks, most in the middle ones
        before, left = (rotation, translation), left - DT


def test_what_stands_still_is_not_touched(one):
    """To the last bit, so that a scene need not ask it anew, and forces do not shiver."""
    scene, poses = one
    given = [part[None] for part in scene.lies(0)]
    poses.give(*given, STILL, spins=STILL, period=2e-3)
    poses.step(2e-3)
    wanted = np.concatenate([part.ravel() for part in scene.lies(0)])
    assert wanted == pytest.approx(np.concatenate([part.ravel() for part in given]), abs=1e-15)
    for _ in range(20):
        poses.give(*given, STILL, spins=STILL, period=2e-3)
        for _ in range(3):
            poses.step(DT)
            assert same_bits(np.concatenate([p.ravel() for p in scene.lies(0)]), wanted)


def test_a_late_simulation_stops_its_objects_and_the_newest_frame_counts(one):
    scene, poses = one
    rotation, start = scene.lies(0)
    for far in (5.0, 7.0, 1.0):  # the first two are never followed
        poses.give(rotation[None], far + start[None], STILL, spins=STILL, period=2e-3)
    assert [poses.step(DT) for _ in range(5)] == [True, *[False] * 4]
    assert scene.lies(0)[1] == pytest.approx(1.0 + start, abs=1e-15)


def test_what_is_no_pose_is_not_handed_over(one):
    scene, poses = one
    before = scene.lies(0)
    rotation, nan = before[0][None], np.full((1, 3), np.nan)
    place_ = before[1][None]
    good = rotation, place_, STILL, STILL
    broken = [
        (rotation * 1.01, *good[1:]), (-rotation, *good[1:]), (rotation, nan, STILL, STILL),
        (rotation, place_, nan, STILL), (rotation, place_, STILL, nan),
        (rotation, place_, STILL, [[0, 0, 400.0]]),
    ]  # fmt: skip
    for *given, spins in broken:
        with pytest.raises(ValueError, match="nothing was handed over"):
            poses.give(*given, spins=spins, period=0.01)
    for period in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="nothing was handed over"):
            poses.give(*good[:3], spins=good[3], period=period)
    with pytest.raises(ValueError, match="the scene has 1 objects"):
        poses.give(rotation, np.zeros((2, 3)), STILL, spins=STILL, period=0.01)
    assert not poses.step(DT)
    assert np.array_equal(scene.lies(0)[1], before[1])


def test_what_lies_nowhere_is_not_moved(one):
    scene, _ = one
    with pytest.raises(PandisError, match="its rotation"):
        scene.move(0, scene.objects[0]._replace(rotation=np.zeros((3, 3))))
    with pytest.raises(PandisError, match="its rotation"):
        Poses(scene)


def test_every_tick_sees_one_whole_frame_while_another_thread_gives(files):
    """All objects have the number of their frame as place; numbers never go back."""
    scene = NativeScene(room(files, ["sphere"], 40, 5))
    poses, frames = Poses(scene), 3000
    upright, still = np.tile(np.eye(3), (40, 1, 1)), np.zeros((40, 3))
    taken = threading.Semaphore(0)

    def simulate():
        for number in range(1, frames + 1):
            poses.give(upright, np.full((40, 3), float(number)), still, spins=still, period=1e-9)
            if number % 300 == 0:  # so that some are seen, however threads are scheduled
                assert taken.acquire(timeout=60)

    thread, seen = threading.Thread(target=simulate), [0.0]
    thread.start()
    while thread.is_alive():
        if not poses.step(DT):  # in one tick it is there
            continue
        taken.release()
        places = np.array([scene.lies(i)[1] for i in range(40)])
        assert (places == places[0, 0]).all()
        seen.append(places[0, 0])
    thread.join()
    if poses.step(DT):
        seen.append(scene.lies(0)[1][0])
    assert seen == sorted(seen)
    assert seen[-1] == frames
    assert len(seen) > 5


@pytest.mark.slow
def test_forces_among_moving_objects_are_those_of_each_alone(files):
    """To the last bit, in scenes that skip, with proxies and without."""
    names, count, rng = ("sphere", "exact", "spline"), 60, np.random.default_rng(8)
    objects = room(files, names, count, 11)
    touched, penal = TouchedScene(objects), NativeScene(objects)
    alone = [NativeContact(placed) for placed in objects]
    moved = [Poses(touched), Poses(penal)]
    path, pressed = 4 * walk(600, rng, 0.03), 0
    for tick, point in enumerate(path):
        if tick % 10 == 0:
            poses = [touched.lies(i) for i in range(count)]
            speed, spin = 0.1 * rng.normal(size=(2, count, 3)) * [[[1]], [[20]]]
            speed[::3] = spin[::3] = 0
            for each in moved:
                rotations, translations = map(np.array, zip(*poses, strict=True))
                each.give(rotations, translations, speed, spins=spin, period=0.01)
        for each in moved:
            each.step(DT)
        sums = np.zeros((2, 3))
        for i, contact in enumerate(alone):
            contact.move(Placed(objects[i].field, *touched.lies(i), *objects[i][3:]))
            sums[0] += contact.follow(point[None]).force[0]
        sums[1] = penal.ask_all(point[None])[0]
        assert same_bits(touched.follow(point[None]).force[0], sums[0])
        assert same_bits(penal.answer(point[None]).force[0], sums[1])
        pressed += sums[0].any()
    assert 50 < pressed < 550


def test_a_moving_object_pushes_smoothly_and_in_steps_without(files):
    """A block comes at 0.1 m/s against a probe that stays, in frames of 100 Hz."""
    field, speed = NativeField(files["box"]), np.array([[0.1, 0, 0]])
    forces = {}
    for way in ("poses", "frames"):
        scene = TouchedScene([Placed.at(field, 0.1, 400.0)])
        poses = Poses(scene)
        rotation, start = scene.lies(0)
        probe = np.array([[0.06, 0, 0]])
        forces[way] = []
        for tick in range(200):
            if tick % 10 == 0:
                now = start + tick * DT * speed[0]
                if way == "poses":
                    poses.give(rotation[None], now[None], speed, spins=STILL, period=0.01)
                else:
                    scene.move(0, Placed(field, rotation, now, *scene.objects[0][3:]))
            if way == "poses":
                poses.step(DT)
            forces[way].append(scene.follow(probe).force[0])
    smooth, stepped = (np.linalg.norm(np.diff(forces[way], axis=0), axis=1).max()
                       for way in ("poses", "frames"))  # fmt: skip
    assert max(np.linalg.norm(forces["poses"], axis=1)) > 1.0
    assert smooth < 400 * 0.1 * DT * 1.01
    assert stepped > 5 * smooth

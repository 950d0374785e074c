"""Contacts: the proxy stays outside, comes to rest where it should, rubs as Coulomb says, and
scenes skip nothing that counts."""

import numpy as np
import pytest

from conftest import FRAME
from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE, Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.contact import (  # fmt: skip
    STICKING,
    TOUCHING,
    WAITING,
    Material,
    NativeContact,
    TouchedScene,
)
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed
from support import artifact

#: Everything that knows a distance outside.
KNOWING = (
    *("exact", "compact", "spline", "tricubic", "trilinear-normal", "trilinear-gradient"),
    *("gradient", "sphere", "torus", "box", "capsule"),
)
#: Their surfaces are those of what they were made from.
EXACT = "exact", "compact", "sphere", "torus", "box", "capsule"


def placed(field, size=0.1, stiffness=400.0, **pose):
    """Return a field of 10 cm, in metres and newtons."""
    return Placed.at(field, size, stiffness, **pose)


def opened(files, name):
    """Return a field, and the metres of a unit of its mesh at a longest side of 10 cm."""
    field = NativeField(files[name])
    return field, 0.1 * field.frame.scale / UNIT_SIDE


def metres(field, points, size=0.1):
    """Put points (n, 3) of a field's mesh to where `placed` lays them."""
    return field.frame.to_unit(points) * size / UNIT_SIDE


def surface_of(field, count, seed=0, start=0.05):
    """Return points (n, 3) of a field's own surface, mesh units, and the normals there."""
    rng = np.random.default_rng(seed)
    points = field.frame.to_mesh(rng.uniform(-0.9, 0.9, (20 * count, 3)))
    unit = field.frame.scale
    distance = field.query(points).distance * unit
    points = points[np.abs(distance) < start][:count]
    for _ in range(20):
        distance, normal = field.distance_and_normal(points)
        points = points - distance[:, None] * normal
    distance, normal = field.distance_and_normal(points)
    good = np.abs(distance) * unit < 1e-6
    return points[good], normal[good]


def mesh_field(vertices, faces):
    """Return the exact field of a mesh, and the frame."""
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    held = artifact("mesh", {"vertices": vertices, "faces": faces},
                    {**frame.attributes(), "shape": None})  # fmt: skip
    return NativeField(native_bytes(ExactField("exact", Body.open(held)), {}))


def box_mesh(low, high):
    """Return vertices and faces of a box, outward."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    low, high = np.array(low, float), np.array(high, float)
    return low + corners * (high - low), np.array(faces)


def several(*parts):
    """Return meshes as one."""
    starts = np.cumsum([0, *(len(v) for v, _ in parts[:-1])])
    faces = [f + start for (_, f), start in zip(parts, starts, strict=True)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(faces)


def approach(contact, start, end, steps=40, rest=100):
    """Go straight from one place to another and stay there; returns the `Touches`."""
    way = np.linspace(0, 1, steps)[:, None]
    path = np.concatenate([start + way * (end - start), np.tile(end, (rest, 1))])
    return contact.follow(path)


@pytest.mark.parametrize("name", ["sphere", "capsule", "torus"])
def test_at_rest_the_proxy_is_the_closest_point_of_a_closed_form(files, name):
    field, unit = opened(files, name)
    feet, normals = surface_of(field, 60)
    rng = np.random.default_rng(1)
    tried = 0
    for foot, normal in zip(metres(field, feet), normals, strict=True):
        depth = rng.uniform(0.001, 0.008)
        side = np.cross(normal, rng.normal(size=3))
        end = foot - depth * normal + 0.002 * side / np.linalg.norm(side)
        in_mesh = field.frame.to_mesh(end[None] * UNIT_SIDE / 0.1)
        distance, outward = field.distance_and_normal(in_mesh)
        if not distance[0] * unit < -2e-4:
            continue
        closest = metres(field, in_mesh - distance[:, None] * outward)[0]
        touches = approach(NativeContact(placed(field)), foot + 0.002 * normal, end)
        assert touches.state[-1] == TOUCHING
        off = np.linalg.norm(touches.proxy[-1] - closest) * UNIT_SIDE / 0.1
        if np.linalg.norm(closest - foot) < 0.006:  # else another wall may be nearer
            tried += 1
            # between the curvatures of a saddle it comes to rest more slowly
            assert off < (1e-5 if name == "torus" else 1e-9)
            assert touches.queries[-1] == 0 or name == "torus"
    assert tried > 30


@pytest.mark.parametrize("name", ["exact", "compact"])
def test_at_rest_nothing_of_a_mesh_near_the_proxy_is_nearer_to_the_probe(files, name):
    field, _ = opened(files, name)
    feet, normals = surface_of(field, 60)
    rng = np.random.default_rng(2)
    unit = UNIT_SIDE / 0.1
    for foot, normal in zip(metres(field, feet), normals, strict=True):
        side = np.cross(normal, rng.normal(size=3))
        end = foot - rng.uniform(0.0005, 0.003) * normal + 0.001 * side / np.linalg.norm(side)
        touches = approach(NativeContact(placed(field)), foot + 0.002 * normal, end)
        if touches.state[-1] & TOUCHING:
            proxy = touches.proxy[-1] * unit
            assert gain_near(field, proxy, end * unit, 1e-5, rng) < 1e-6


def gain_near(field, proxy, probe, reach, rng):
    """Return by how much a place of the surface near a proxy is nearer to the probe; unit frame."""
    points = field.frame.to_mesh(proxy + rng.normal(size=(400, 3)) * reach)
    for _ in range(3):
        distance, outward = field.distance_and_normal(points)
        points = points - distance[:, None] * outward
    others = np.linalg.norm(field.frame.to_unit(points) - probe, axis=1)
    return np.linalg.norm(proxy - probe) - others.min()


def test_it_comes_to_rest_in_a_concave_edge_and_in_a_corner():
    floor = box_mesh((-1, -1, -1), (1, 1, 0))
    # the solids reach into each other
    wall = box_mesh((-1, -1, -0.5), (-0.6, 1, 1))
    other = box_mesh((-0.8, 0.6, -0.5), (1, 1, 0.9))
    field = mesh_field(*several(floor, wall, other))
    scene = Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0)
    edge = approach(
        NativeContact(scene), np.array([0, 0, 0.3]), np.array([-0.8, -0.1, -0.2]), rest=400
    )
    assert edge.planes[-1] == 2
    assert np.abs(edge.proxy[-1] - [-0.6, -0.1, 0]).max() < 1e-9
    corner = approach(
        NativeContact(scene), np.array([0, 0, 0.3]), np.array([-0.8, 0.7, -0.2]), rest=400
    )
    assert corner.planes[-1] == 3
    assert np.abs(corner.proxy[-1] - [-0.6, 0.6, 0]).max() < 1e-9
    for touches in (edge, corner):
        assert np.abs(np.diff(touches.proxy[-50:], axis=0)).max() < 1e-9
        assert touches.queries[-1] == 0


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_nothing_thin_is_jumped_over(radius):
    field = mesh_field(*box_mesh((-1, -1, 0), (1, 1, 1e-4)))
    scene = Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0)
    path = np.array([[0.1, 0.2, 1], [0.15, 0.2, -3], [0.2, 0.1, -0.5], [0.2, 0.1, 0.8]])
    touches = NativeContact(scene, radius).follow(path)
    assert (touches.proxy[1:3, 2] > 0).all()
    assert np.allclose(touches.proxy[1:3, 2], radius + 1e-4, atol=1e-6)
    assert np.abs(touches.proxy[3] - path[3]).max() < 1e-12
    assert list(touches.state & TOUCHING) == [0, 1, 1, 0]


@pytest.mark.parametrize("ticks", [8000, pytest.param(1_000_000, marks=pytest.mark.full)])
@pytest.mark.parametrize("name", KNOWING)
def test_random_motion_never_takes_the_proxy_inside(files, name, ticks):
    field, unit = opened(files, name)
    rng = np.random.default_rng(3)
    turns = np.arange(ticks)[:, None] * 0.004
    path = sum(
        0.03 * rng.normal(size=3) * np.sin(rng.uniform(1, 6, 3) * turns + rng.uniform(0, 6, 3))
        for _ in range(6)
    )
    path[0] = 0.5
    contact = NativeContact(placed(field), material=Material(0.3, 0.2, 0.5, 0.1))
    touches = contact.follow(path)
    assert np.isfinite(touches.force).all()
    assert touches.queries.max() <= contact.options.budget + 2
    held = (touches.state & TOUCHING) > 0
    assert held.mean() > 0.01
    inside = field.query(field.frame.to_mesh(touches.proxy * UNIT_SIDE / 0.1)).distance * unit
    slack = 2e-5 if name in EXACT else 1e-3
    assert inside.min() > -slack


def test_the_force_changes_by_no_more_than_its_bound(files):
    field, _ = opened(files, "exact")
    rng = np.random.default_rng(4)
    turns = np.arange(6000)[:, None] * 0.01
    path = sum(0.03 * rng.normal(size=3) * np.sin(rng.uniform(1, 6, 3) * turns) for _ in range(6))
    path[0] = 0.5
    contact = NativeContact(placed(field, stiffness=1000.0))
    slide = contact.options.slide
    force = contact.follow(path, dt=1e-3).force
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    changed = np.linalg.norm(np.diff(force, axis=0), axis=1)
    assert (changed <= 1000 * (2 * moved + slide * 1e-3) + 1e-9).all()
    assert changed.max() > 0.01


def test_a_probe_that_begins_inside_is_neither_pushed_out_nor_let_through(files):
    field, _ = opened(files, "sphere")
    contact = NativeContact(placed(field))
    first = contact.follow(np.tile([0.045, 0, 0], (5, 1)))
    assert (first.state == WAITING).all()
    assert not first.force.any()
    deeper = approach(contact, np.array([0.045, 0, 0]), np.array([0.04, 0, 0]))
    assert deeper.force[-1] == pytest.approx([400 * 0.005, 0, 0], rel=1e-6, abs=1e-9)
    assert deeper.state[-1] == WAITING | TOUCHING
    across = contact.follow(
        np.linspace([0.04, 0, 0], [-0.04, 0, 0], 3)
    )  # it does not come out there
    assert (np.linalg.norm(across.proxy, axis=1) > 0.045 - 1e-9).all()
    back = contact.follow(np.linspace([-0.04, 0, 0], [0.047, 0, 0], 50))
    assert not back.force[-1].any()
    risen = approach(contact, np.array([0.047, 0, 0]), np.array([0.04, 0, 0]))  # as far as it came
    assert risen.force[-1] == pytest.approx([400 * 0.007, 0, 0], rel=1e-6, abs=1e-9)
    out = contact.follow(np.linspace([0.04, 0, 0], [0.2, 0, 0], 50))
    assert out.state[-1] == 0
    pressed = contact.follow([[0.045, 0, 0]])
    assert pressed.force[0] @ [1, 0, 0] == pytest.approx(400 * 0.005, rel=1e-3)


def test_from_the_middle_the_whole_way_out_is_free(files):
    field, _ = opened(files, "sphere")
    contact = NativeContact(placed(field))
    assert (contact.follow(np.zeros((5, 3))).state == WAITING).all()
    assert contact.follow([[0.2, 0, 0]]).state[0] == 0
    pressed = contact.follow([[0.045, 0, 0]])
    assert pressed.force[0] @ [1, 0, 0] == pytest.approx(400 * 0.005, rel=1e-3)


@pytest.mark.parametrize("radius", [0.0, 0.002])
@pytest.mark.parametrize("name", KNOWING)
def test_walls_stand_where_a_probe_began_inside(files, name, radius):
    """However it moves inside, its proxy lies no deeper than the probe has been since it began."""
    field, unit = opened(files, name)
    feet, normals = surface_of(field, 30, seed=5)
    rng, tried = np.random.default_rng(2), 0
    for foot, normal in zip(metres(field, feet), normals, strict=True):
        start = foot - 0.0015 * normal
        inside = field.query(field.frame.to_mesh(start[None] * UNIT_SIDE / 0.1))
        if not (inside.flag[0] == 0 and inside.distance[0] * unit < -0.001):
            continue
        contact = NativeContact(placed(field), radius=radius)
        ends = start + 0.01 * rng.normal(size=(4, 3)) - 0.004 * normal
        way = np.concatenate([[start], *np.linspace(start, ends, 25).transpose(1, 0, 2)])
        found = contact.follow(way)
        assert not found.force[0].any()
        depth = -unit * np.minimum(
            0, field.query(field.frame.to_mesh(found.proxy * UNIT_SIDE / 0.1)).distance
        )
        probe = -unit * field.query(field.frame.to_mesh(way * UNIT_SIDE / 0.1)).distance
        assert depth.max() <= probe[0] + (1e-6 if name in EXACT else 1e-4)
        tried += found.force.any()
        out = NativeContact(placed(field), radius=radius)  # and the way out is free
        assert not out.follow(start + np.linspace(0, 0.01, 100)[:, None] * normal).force.any()
    assert tried > 5


def test_a_probe_that_begins_inside_a_plate_does_not_come_out_on_its_other_side():
    field = mesh_field(*box_mesh((-0.05, -0.05, 0), (0.05, 0.05, 0.002)))
    top = metres(field, np.array([[0, 0, 0.0015], [0.01, 0, -0.01]]))
    contact = NativeContact(placed(field))
    found = approach(contact, *top, steps=2)
    level = metres(field, np.array([[0, 0, 0.0015]]))[0, 2]
    assert (found.proxy[:, 2] >= level - 1e-9).all()
    assert found.force[-1, 2] == pytest.approx(400 * (level - top[1, 2]), rel=1e-6)


def test_what_is_no_position_moves_nothing_and_gives_no_force(files):
    field, _ = opened(files, "sphere")
    contact = NativeContact(placed(field))
    contact.follow(np.linspace([0.1, 0, 0], [0.04, 0, 0], 50))
    broken = contact.follow([[np.nan, 0, 0], [0, np.inf, 0]])
    assert not broken.force.any()
    assert (broken.flag == 2).all()
    assert contact.follow([[0.04, 0, 0]]).force[0, 0] == pytest.approx(4.0, rel=1e-6)


@pytest.mark.parametrize("name", ["nearest", "trilinear"])
def test_a_grid_of_forces_says_that_it_has_no_contact(files, name):
    with pytest.raises(PandisError, match="has no distances outside"):
        NativeContact(placed(NativeField(files[name])))


@pytest.mark.parametrize("friction", np.round(np.linspace(0.1, 1.0, 10), 2))
def test_a_block_on_an_incline_holds_and_slides_as_coulomb_says(files, friction):
    field, _ = opened(files, "box")
    distance = field.query(field.frame.to_mesh(np.array([[0.0, 0, 0.9]]))).distance[0]
    top = (0.9 - distance * field.frame.scale) * 0.1 / UNIT_SIDE
    material, stiffness, mass, dt = Material(friction, friction, 0, 0), 2000.0, 0.05, 1e-4

    def let_go(angle, steps, air):
        """Return how far (m) the block has gone along the incline, step by step."""
        contact = NativeContact(placed(field, stiffness=stiffness), material=material)
        weight = 9.81 * mass * np.array([np.sin(angle), 0, -np.cos(angle)])
        place = np.array([-0.03, 0.0, top])
        contact.follow(place + np.array([[0, 0, 1e-3], [0, 0, 1e-6]]))
        place[2] += weight[2] / stiffness
        speed, way = np.zeros(3), []
        for _ in range(steps):
            force = contact.follow(place[None], dt).force[0]
            speed += dt * (force + weight - air * speed) / mass
            speed[2] = 0  # the block lies; it does not bounce
            place += dt * speed
            way.append(place[0] + 0.03)
        return np.array(way)

    held = let_go(np.arctan(0.8 * friction), 4000, 20.0)
    leaning = 9.81 * mass * np.sin(np.arctan(0.8 * friction)) / stiffness
    assert held[-1] == pytest.approx(leaning, rel=1e-3)  # on its spring, and no farther
    angle = np.arctan(friction) + 0.2
    way = let_go(angle, 1000, 0.0)
    expected = 9.81 * (np.sin(angle) - friction * np.cos(angle))
    lag = friction * 9.81 * mass * np.cos(angle) / stiffness
    seconds = np.arange(1, 1001) * dt
    fitted = np.polyfit(seconds[300:], way[300:] - lag, 2)[0] * 2
    assert fitted == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("friction", np.round(np.linspace(0.1, 1.0, 10), 2))
def test_at_constant_speed_it_drags_with_the_sliding_friction(files, friction):
    field, _ = opened(files, "box")
    distance = field.query(field.frame.to_mesh(np.array([[0.0, 0, 0.9]]))).distance[0]
    top = (0.9 - distance * field.frame.scale) * 0.1 / UNIT_SIDE
    contact = NativeContact(placed(field), material=Material(1.5 * friction, friction, 0, 0))
    depth, steps = 0.002, np.arange(300)
    path = np.stack([-0.02 + 1e-4 * steps, 0 * steps, np.full(300, top - depth)], axis=1)
    touches = contact.follow(np.concatenate([[[-0.02, 0, top + 1e-3]], path]))
    along = -touches.force[-100:, 0]
    assert along == pytest.approx(friction * 400 * depth, rel=0.01)
    first = np.flatnonzero(touches.slip > 1e-9)[0]  # it breaks loose at the larger one
    assert -touches.force[first - 1, 0] == pytest.approx(1.5 * friction * 400 * depth, abs=0.041)


def test_at_half_of_the_cone_it_sticks_for_a_minute_without_creeping(files):
    field, _ = opened(files, "sphere")
    contact = NativeContact(placed(field), material=Material(0.5, 0.4, 1.0, 0.5))
    rng = np.random.default_rng(5)
    contact.follow(np.linspace([0, 0, 0.06], [0, 0, 0.048], 30))
    leaning = np.array([0.0005, 0, 0.048]) + rng.normal(0, 2e-6, (60_000, 3))
    touches = contact.follow(leaning)
    assert (touches.state == TOUCHING | STICKING).all()
    assert (touches.proxy == touches.proxy[0]).all()


@pytest.mark.parametrize("name", ["exact", "compact", "sphere", "spline"])
@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("loops", [25, pytest.param(1000, marks=pytest.mark.full)])
def test_closed_loops_give_no_energy(files, name, friction, loops):
    field, _ = opened(files, name)
    feet, normals = surface_of(field, loops)
    worst = 0.0
    for foot, normal in zip(metres(field, feet), normals, strict=True):
        first, second = np.linalg.svd(normal[None])[2][1:]
        turn = np.linspace(0, 2 * np.pi, 400)[:, None]
        height = -0.0015 + 0.003 * np.cos(turn)  # in and out: the contact begins and ends
        loop = foot + height * normal + 0.002 * (np.sin(turn) * first + np.sin(2 * turn) * second)
        material = Material(friction, friction, 0, 0)
        force = NativeContact(placed(field), material=material).follow(loop).force
        # what is held during a tick is the force of its beginning: half of what it loses is not
        # the contact's doing
        middle = (force[:-1] + force[1:]) / 2
        work = np.einsum("ij,ij->", middle, np.diff(loop, axis=0))
        worst = max(worst, work / (0.5 * 400 * 0.003**2))
    assert worst < (0.01 if friction == 0 else 0.002)


def scene_of(files, count, seed=0, sort=("exact", "compact", "spline", "torus", "box")):
    """Return many objects near each other, some of which overlap."""
    rng = np.random.default_rng(seed)
    fields = [NativeField(files[name]) for name in sort]
    objects = []
    for index in range(count):
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turned *= np.sign(np.linalg.det(turned))
        place = rng.uniform(-0.1, 0.1, 3)
        objects.append(placed(fields[index % len(fields)], 0.05, position=place, rotation=turned))
    return objects


def wander(count, seed=0, size=0.04):
    """Return a smooth path (n, 3) that begins far away."""
    rng = np.random.default_rng(seed)
    turns = np.arange(count)[:, None] * 0.002
    path = sum(size * rng.normal(size=3) * np.sin(rng.uniform(1, 9, 3) * turns) for _ in range(6))
    return path + np.array([0.5, 0.4, 0.3]) * np.exp(-turns * 8)


def test_a_scene_gives_the_forces_of_stepping_everything_to_the_last_bit(files):
    objects = scene_of(files, 40)
    materials = [Material(0.3, 0.2, 0.5, 0.1) if i % 2 else None for i in range(40)]
    scene, path = TouchedScene(objects, 0.0005, materials), wander(20_000)
    wanted = scene.step_all(path)
    got = scene.follow(path)
    assert (got.force == wanted).all()
    assert (got.touched > 0).mean() > 0.02
    assert (got.touched > 1).any()
    assert (got.queries == 0).mean() > 0.05  # the others press on


def test_a_scene_whose_objects_move_gives_the_same_forces(files):
    objects = scene_of(files, 12, seed=1)
    one, many = TouchedScene(objects), [NativeContact(item) for item in objects]
    rng, path = np.random.default_rng(7), wander(3000, seed=1)
    for index, position in enumerate(path):
        if index % 3 == 0:
            which = int(rng.integers(12))
            item = objects[which]
            objects[which] = item._replace(translation=item.translation + rng.normal(0, 3e-4, 3))
            one.move(which, objects[which])
            many[which].move(objects[which])
        got = one.follow(position[None])
        wanted = np.zeros(3)
        for contact in many:
            wanted = wanted + contact.follow(position[None]).force[0]
        assert (got.force[0] == wanted).all(), index


@pytest.mark.parametrize("seed", range(3))
def test_penalty_forces_asked_between_touches_change_neither(files, seed):
    """One such call took a wall away for a third of a second, and gave it back in one tick."""
    objects = scene_of(files, 12, seed)
    asked, touched, penal = TouchedScene(objects), TouchedScene(objects), NativeScene(objects)
    rng, path = np.random.default_rng(seed), wander(4000, seed)
    pressed = 0
    for position in path:
        if rng.random() < 0.02:
            which = int(rng.integers(12))
            item = objects[which]
            objects[which] = item._replace(translation=item.translation + rng.normal(0, 3e-4, 3))
            for scene in (asked, touched, penal):
                scene.move(which, objects[which])
        if rng.random() < 0.3:
            beside = position + rng.normal(0, rng.choice([0, 1e-3, 1e-2]), (2, 3))
            force = asked.answer(beside).force
            assert (force == penal.answer(beside).force).all()
            pressed += force.any()
        got, wanted = (scene.follow(position[None]) for scene in (asked, touched))
        assert (got.force == wanted.force).all()
    assert pressed > 20


def test_a_scene_lists_what_is_touched(files):
    field, _ = opened(files, "sphere")
    pair = [placed(field, position=(x, 0, 0)) for x in (0.0, 0.08, 0.5)]
    scene = TouchedScene(pair)
    scene.follow(np.linspace([0.04, 0, 0.1], [0.04, 0, 0.032], 40))
    objects, touches = scene.touches([0.04, 0, 0.026])
    assert list(objects) == [0, 1]
    assert (touches.depth > 0.001).all()
    force = NativeScene(pair).ask_all([[0.04, 0, 0.026]])[0]
    total = touches.force.sum(axis=0)
    assert total[0] == pytest.approx(0, abs=1e-9)
    assert total[2] > force[2] * 0.5


def test_an_object_that_moves_takes_its_proxy_along(files):
    field, _ = opened(files, "box")
    contact = NativeContact(placed(field))
    contact.follow(np.linspace([0, 0, 0.06], [0, 0, 0.02], 40))
    probe = np.array([[0, 0, 0.02]])
    before = contact.follow(probe)
    for step in range(200):  # the box rises around the probe, far beyond it
        contact.move(placed(field, position=(0, 0, 0.0005 * step)))
        after = contact.follow(probe)
    assert after.proxy[0, 2] == pytest.approx(before.proxy[0, 2] + 0.0005 * 199, abs=1e-6)


def test_a_shape_that_comes_over_the_proxy_pushes_it_out(files):
    field, _ = opened(files, "exact")
    moving = field.moving()
    vertices = FRAME.to_mesh(Body.open(_mesh_of(files)).distance.vertices)
    contact = NativeContact(placed(moving))
    outside = np.array([[0.0, 0.0, 0.03]])
    contact.follow(outside)
    centre = vertices.mean(axis=0)
    moving.refit(centre + 3 * (vertices - centre))
    contact.reshaped()
    grown = contact.follow(outside)
    distance = moving.query(field.frame.to_mesh(grown.proxy * UNIT_SIDE / 0.1)).distance
    assert distance[0] > -1e-6


def _mesh_of(files):
    from pandis.pipeline.geometry.shapes import SHAPES

    vertices, faces = SHAPES["torus"].tessellation(60, 30)
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    arrays = {"vertices": FRAME.to_mesh(frame.to_unit(vertices)), "faces": faces}
    return artifact("mesh", arrays, {**FRAME.attributes(), "shape": None})

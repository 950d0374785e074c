"""Textures: heights over a surface that a proxy feels, and what they must not do."""

import ctypes

import numpy as np
import pytest
from test_contact import metres, opened, placed, surface_of

from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.run.ask.contacts import ContactOptions
from pandis.runtime.contact import BEHIND, TOUCHING, Feel, Material, NativeContact
from pandis.runtime.contact.surfaces import HEIGHT, Texture, texture_for, textures_for
from pandis.runtime.field import NativeField


def ball(files):
    """Return a ball of 5 cm, placed, and how many units of its mesh are a metre."""
    field = NativeField(files["sphere"])
    return placed(field), UNIT_SIDE / field.frame.scale / 0.1


def heights(texture, points, region=-1):
    """Return heights (n,) and gradients (n, 3) of a texture in a region, as C gives them."""
    function, found = HEIGHT(texture.height), []
    for point in points:
        gradient = (ctypes.c_double * 3)()
        given = (ctypes.c_double * 3)(*point)
        raised = function(texture.data, ctypes.pointer(given), region, ctypes.pointer(gradient))
        found.append((raised, *gradient))
    return np.array(found)[:, 0], np.array(found)[:, 1:]


@pytest.mark.parametrize(
    "texture", [lambda: Texture.waves(0.3, 2.0, (1, 2, 2)), lambda: Texture.noise(0.3, 1.5)]
)
def test_heights_have_the_gradients_and_bounds_that_they_say(texture):
    texture, rng = texture(), np.random.default_rng(0)
    points = rng.uniform(-40, 40, (4000, 3))
    raised, slope = heights(texture, points)
    assert 0 <= raised.min() < 0.1 * texture.most
    assert 0.9 * texture.most < raised.max() <= texture.most
    assert np.linalg.norm(slope, axis=1).max() <= texture.steepest
    for axis in np.eye(3):
        ahead, behind = (heights(texture, points + sign * 1e-5 * axis)[0] for sign in (1, -1))
        assert (ahead - behind) / 2e-5 == pytest.approx(slope @ axis, abs=1e-5)


def test_a_proxy_goes_up_and_down_over_waves(files):
    """Drawn over a ball, it lies at the height of the waves, and the force has their slope."""
    where, per_metre = ball(files)
    length, height = 0.004 * per_metre, 0.0002 * per_metre
    texture = Texture.waves(height, length, (1, 0, 0))
    contact = NativeContact(where, texture=texture)
    turn = np.linspace(-0.3, 0.3, 3000)
    over = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    start = np.linspace(0.06, 0.0495, 60)[:, None] * over[0]
    touches = contact.follow(np.concatenate([start, 0.0495 * over]))
    proxy, force = touches.proxy[60:], touches.force[60:]
    rises = (np.linalg.norm(proxy, axis=1) - 0.05) * per_metre
    feet = 0.05 * proxy / np.linalg.norm(proxy, axis=1)[:, None] * per_metre
    wanted = heights(texture, feet)[0]
    assert rises == pytest.approx(wanted, abs=0.03 * height)
    assert (touches.state[60:] & TOUCHING).all()
    radial = np.einsum("ij,ij->i", force, over)
    aside = force - radial[:, None] * over
    assert np.abs(aside).max() > 0.1 * radial.max()  # a plain ball gives none


@pytest.mark.parametrize("name", ["exact", "compact", "spline", "tricubic", "gradient", "sphere"])
def test_a_texture_lets_nothing_further_in_than_without_it(files, name):
    field, unit = opened(files, name)
    per_metre = UNIT_SIDE / field.frame.scale / 0.1
    texture = Texture.noise(0.0005 * per_metre, 0.003 * per_metre)
    feet, normals = surface_of(field, 12)
    deepest, touched = 0.0, 0
    for foot, normal in zip(metres(field, feet), normals, strict=True):
        contact = NativeContact(placed(field), material=Material(0.3, 0.3), texture=texture)
        along = np.cross(normal, (0.3, 0.5, 0.8))
        sweep = np.sin(np.linspace(0, 12, 600))[:, None] * along * 0.004
        down = np.linspace(0.004, -0.003, 100)[:, None] * normal
        path = foot + np.concatenate([down, sweep - 0.003 * normal])
        touches = contact.follow(path)
        assert np.isfinite(touches.force).all()
        held = (touches.state & TOUCHING) > 0
        touched += held.sum()
        points = field.frame.to_mesh(touches.proxy[held] * UNIT_SIDE / 0.1)
        if held.any():
            deepest = max(deepest, -field.query(points).distance.min() * unit)
    assert touched > 2000
    assert deepest < 1e-4


@pytest.mark.parametrize("kind", ["waves", "noise"])
def test_a_proxy_keeps_up_on_the_steepest_texture_that_the_configuration_takes(files, kind):
    """Drawn over a ball it slides as far as without a texture, and is seldom behind."""
    where, _ = ball(files)
    asked = ContactOptions(texture={"kind": kind, "height": 2e-4, "length": 1e-3})
    texture = texture_for(textures_for(asked, None), where.scale)
    assert texture.steepest > 0.62
    turn = np.linspace(-0.3, 0.3, 3000)
    over = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    start = np.linspace(0.06, 0.0495, 60)[:, None] * over[0]
    path = np.concatenate([start, 0.0495 * over])
    touches, plain = (NativeContact(where, texture=t).follow(path) for t in (texture, None))
    apart = np.linalg.norm(touches.proxy - plain.proxy, axis=1)[60:]
    assert (touches.state[60:] & BEHIND > 0).mean() < 0.1
    assert np.median(apart) < 3e-4
    assert apart[-1] < 1e-3
    assert touches.slip.sum() > 0.9 * plain.slip.sum() > 0


def test_without_a_texture_or_with_a_flat_one_a_ball_is_where_it_was(files):
    where, _ = ball(files)
    flat = Texture.of(lambda point, region: (0.0, (0, 0, 0)), 0.0, 0.0)
    path = np.linspace(0.06, 0.045, 100)[:, None] * np.array([[0.6, 0.0, 0.8]])
    one, other = (NativeContact(where, texture=t).follow(path) for t in (None, flat))
    assert other.proxy == pytest.approx(one.proxy, abs=1e-9)


def test_a_texture_of_a_users_own_may_say_no_number(files):
    where, _ = ball(files)
    wrong = Texture.of(lambda point, region: (np.nan, (np.nan, 0, np.inf)), 1.0, 1.0)
    path = np.linspace(0.06, 0.045, 100)[:, None] * np.array([[0.6, 0.0, 0.8]])
    touches = NativeContact(where, texture=wrong).follow(path)
    assert np.isfinite(touches.force).all()
    assert np.isfinite(touches.proxy).all()


def test_a_texture_of_the_configuration_is_in_metres_of_the_object(files):
    where, per_metre = ball(files)
    asked = ContactOptions(texture={"kind": "waves", "height": 2e-4, "length": 4e-3})
    texture = texture_for(textures_for(asked, None), where.scale)
    assert texture.most == pytest.approx(2e-4 * per_metre)
    assert texture_for(textures_for(ContactOptions(), None), where.scale) is None
    path = np.linspace(0.06, 0.045, 100)[:, None] * np.array([[0.6, 0.0, 0.8]])
    alone = NativeContact(where, texture=texture).follow(path)
    scene = Feel(texture=texture).scene(where).follow(path)
    assert np.array_equal(scene.force, alone.force)
    assert alone.force.any()

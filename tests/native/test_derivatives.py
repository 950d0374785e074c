"""Gradients and second derivatives of distances: closed forms, features, differences."""

import numpy as np
import pytest
import trimesh
from test_header import points_for

from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import pack_body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import SHAPES
from pandis.runtime.field.files import pack

EYE = np.eye(3)
ANALYTIC = ("spline", "tricubic", "trilinear-normal", "trilinear-gradient", *SHAPES)
NETWORKS = "gradient", "network", "shallow"


def differences(field, points, step, of=None):
    """Return central differences of the distance, or of what else is given, along the axes."""
    of = of or (lambda at: field.query(at).distance)
    sides = [(of(points + step * axis), of(points - step * axis)) for axis in EYE]
    return np.stack([(high - low) / (2 * step) for high, low in sides], axis=-1)


def smooth(field, points, step):
    """Tell where every answer about a point is within the field, and no crease lies between."""
    around = [points + step * (axis * sign) for axis in EYE for sign in (-1, 1)]
    answers = [field.query(at) for at in (points, *around)]
    here = answers[0]
    whole = np.all([answer.flag == 0 for answer in answers], axis=0)
    turned = [np.einsum("ij,ij->i", here.normal, answer.normal) for answer in answers]
    return whole & (np.min(turned, axis=0) > 0.9)


@pytest.mark.parametrize("name", ANALYTIC)
def test_they_are_the_derivatives_of_what_is_answered(files, name):
    """Within cells: a trilinear distance has creases between them, a spline is smooth."""
    field = NativeField(files[name])
    points, step = points_for(field), 1e-6 / field.frame.scale
    points = points[smooth(field, points, 100 * step)]
    gradient, hessian = field.gradient(points), field.hessian(points)
    assert np.array_equal(hessian, hessian.swapaxes(1, 2))
    by_steps = differences(field, points, step)
    bent = differences(field, points, step, field.gradient)
    off = np.abs(gradient - by_steps).max(axis=1)
    turned = np.abs(hessian - bent).max(axis=(1, 2)) / (1 + np.abs(hessian).max(axis=(1, 2)))
    assert len(points) > 200
    assert np.percentile(off, 98) < 1e-6  # the rest lies on creases
    assert np.percentile(turned, 98) < 1e-5


@pytest.mark.parametrize("name", NETWORKS)
def test_those_of_networks_are_differences(files, name):
    """Of the gradient that a network has, or of its distance."""
    field = NativeField(files[name])
    points = points_for(field)
    points = points[np.abs(field.frame.to_unit(points)).max(axis=1) < 0.95]
    step = (2e-3 if name != "network" else 8e-3) / field.frame.scale
    gradient, hessian = field.gradient(points), field.hessian(points)
    assert np.allclose(gradient, differences(field, points, step), atol=0.03)
    assert np.allclose(hessian, hessian.swapaxes(1, 2), atol=1e-12)
    bent = differences(field, points, step, field.gradient)
    size = np.abs(hessian).max()
    assert np.percentile(np.abs(hessian - bent).max(axis=(1, 2)), 90) < 0.1 * size
    if name != "network":
        answer, slope = field.query_slopes(points)
        assert np.array_equal(gradient, slope[:, None] * answer.normal)


def wanted(points, half):
    """Return the second derivatives (n, 3, 3) of the distance to a box, by what is nearest."""
    excess = np.abs(points) - half
    beyond, rows = excess > 0, []
    for point, out, inside in zip(points, np.where(beyond, excess, 0), ~beyond, strict=True):
        length = np.linalg.norm(out)
        round_of = 3 - inside.sum()
        normal = np.sign(point) * out / max(length, 1e-300)
        rest = EYE - np.outer(normal, normal) - np.diag(inside * 1.0)
        rows.append(rest / length if round_of > 1 else np.zeros((3, 3)))
    return np.array(rows)


def mesh_of(kind, half):
    box = trimesh.creation.box(2 * half)
    body = Body(box.vertices, box.faces, Frame.of_bounds(-half, half))
    if kind == "exact":
        return NativeField(native_bytes(ExactField("exact", body), {}, safe=(1, 0)))
    return NativeField(pack(body.frame, file_parts(*pack_body(body, 16)), {}, version=3))


@pytest.mark.parametrize("kind", ["exact", "compact"])
def test_a_mesh_is_flat_at_faces_and_round_at_edges_and_corners(kind):
    """Against arithmetic on a box: all 26 places where something is nearest, and within."""
    half = np.array([1.5, 1.0, 0.75])
    field = mesh_of(kind, half)
    points = np.random.default_rng(0).uniform(-1.6, 1.6, (4000, 3)) * half
    excess = np.abs(points) - half
    points = points[(np.abs(excess) > 0.02).all(axis=1)]  # rounded corners lie a little elsewhere
    counts = np.bincount((np.abs(points) > half).sum(axis=1), minlength=4)
    assert (counts > 100).all()
    exact, tolerance = wanted(points, half), 1e-9 if kind == "exact" else 0.05
    hessian = field.hessian(points)
    assert np.abs(hessian - exact).max() <= tolerance * np.abs(exact).max()
    assert np.array_equal(field.gradient(points), field.query(points).normal)
    flat = (np.abs(points) > half).sum(axis=1) < 2
    assert not hessian[flat].any()


def test_along_its_gradient_a_distance_is_straight(files):
    """Of a mesh, inside and outside: the curvature across is that of what is nearest."""
    field = NativeField(files["exact"])
    points = points_for(field)
    points = points[field.query(points).flag == 0]
    gradient, hessian = field.gradient(points), field.hessian(points)
    size = np.abs(hessian).max(axis=(1, 2))
    assert np.abs(np.einsum("ijk,ik->ij", hessian, gradient)).max() < 1e-9 * size.max()
    assert (size > 0).sum() > 100


def test_units_turn_into_units(files):
    """Twice as large an object bends half as much, and its gradients are the same."""
    for name in ("exact", "spline", "tricubic", "gradient", "network"):
        field = NativeField(files[name])
        frame = field.frame
        twice = field.placed(Frame(tuple(2 * c for c in frame.centre), frame.scale / 2))
        points = points_for(field)[:300]
        assert np.allclose(
            twice.gradient(2 * points), field.gradient(points), atol=1e-5, equal_nan=True
        )
        bent = 2 * twice.hessian(2 * points), field.hessian(points)
        assert np.allclose(*bent, rtol=1e-3, atol=1e-3 * np.nanmax(np.abs(bent[1])), equal_nan=True)


def test_where_there_is_no_answer_there_are_none(files):
    """No number, and grids of forces, which have no distance; and nothing is left unsaid."""
    nowhere = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [1e200, 0, 0]])
    for name in ("exact", "compact", "spline", "gradient", "sphere"):
        field = NativeField(files[name])
        assert np.isnan(field.gradient(nowhere)).all()
        assert np.isnan(field.hessian(nowhere)).all()
        assert np.isfinite(field.hessian(points_for(field))).all()
    for name in ("nearest", "trilinear"):
        field = NativeField(files[name])
        assert np.isnan(field.gradient(points_for(field))).all()
        assert np.isnan(field.hessian(points_for(field))).all()


def test_in_the_middle_of_a_closed_form_there_is_no_quotient_by_zero(files):
    """Where the distance has no derivative, what is said is a number."""
    for name in SHAPES:
        field = NativeField(files[name])
        middle = np.zeros((1, 3))
        assert np.isfinite(field.hessian(middle)).all(), name

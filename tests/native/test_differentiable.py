"""Splines and networks in PyTorch and JAX: the library's answers, and derivatives through them."""

import re

import numpy as np
import pytest
import torch
from test_header import points_for

from pandis.base.errors import PandisError
from pandis.bridges.arrays import jax_field, torch_field
from pandis.runtime.field import NativeField
from support import ROOT

KINDS = "spline", "network", "gradient", "shallow"


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax", reason="no JAX here: pip install jax")
    jax.config.update("jax_enable_x64", True)
    return jax


def away_from_edges(native, count):
    """Return points, all inside of the box: on its faces a clamped point has two derivatives."""
    unit = np.random.default_rng(4).uniform(-0.97, 0.97, (count, 3))
    return native.frame.to_mesh(unit)


def compare(native, points, distance, normal):
    wanted, slopes = native.query_slopes(points)
    close = 1e-6 / native.frame.scale
    assert np.abs(distance - wanted.distance).max() < close
    off = np.linalg.norm(normal - wanted.normal, axis=1) * slopes
    assert off[slopes > 1e-9].max() < 3e-6 * max(1, slopes.max())


@pytest.mark.parametrize("name", KINDS)
def test_torch_answers_as_the_library_does(name, files):
    native, field = NativeField(files[name]), torch_field(files[name])
    points = points_for(native, 5000)
    distance, normal = field.answer(torch.as_tensor(points))
    assert not distance.requires_grad
    compare(native, points, distance.numpy(), normal.numpy())


@pytest.mark.parametrize("name", KINDS)
def test_torch_differentiates_the_distance(name, files):
    """By the points: the gradient that the library computes by formula, or by differences."""
    native, field = NativeField(files[name]), torch_field(files[name])
    points = away_from_edges(native, 3000)
    at = torch.as_tensor(points).requires_grad_()
    field.distance(at).sum().backward()
    wanted = native.gradient(points)
    off = np.linalg.norm(at.grad.numpy() - wanted, axis=1)
    # a bound's is a difference, and at a crease there are two
    close = 1e-4 if name == "spline" else 3e-3
    assert np.percentile(off, 95 if name == "spline" else 100) < close * max(
        1, np.abs(wanted).max()
    )


def test_torch_differentiates_twice(files):
    """The Hessian of the spline is that of the library."""
    native, field = NativeField(files["spline"]), torch_field(files["spline"])
    points = away_from_edges(native, 4000)
    wanted, slopes = native.query_slopes(points)
    near = (
        (np.abs(wanted.distance) * native.frame.scale < 0.05)
        & (slopes > 0.995)
        & (wanted.flag == 0)
    )
    points = points[near][:12]
    assert len(points) == 12
    for point, hessian in zip(points, native.hessian(points), strict=True):
        found = torch.autograd.functional.hessian(
            lambda p: field.distance(p[None])[0], torch.as_tensor(point)
        )
        assert found.numpy() == pytest.approx(hessian, abs=1e-6 * np.abs(hessian).max())


def test_single_precision_stays_single(files):
    field = torch_field(files["spline"])
    native = NativeField(files["spline"])
    points = points_for(native, 2000)  # faces, edges and corners of the box are among them
    distance, normal = field.answer(torch.as_tensor(points, dtype=torch.float32))
    assert distance.dtype == normal.dtype == torch.float32
    assert distance.numpy() == pytest.approx(native.query(points).distance, abs=1e-5)
    assert np.linalg.norm(normal.numpy(), axis=1).min() > 0.99


@pytest.mark.parametrize("name", ["spline", "gradient"])
def test_a_point_that_is_none_spoils_no_other(name, files):
    field = torch_field(files[name])
    points = torch.tensor([[0.1, 0.2, 0.3], [float("nan"), 0, 0], [0.3, 0.2, 0.1]]).double()
    distance, _ = field.answer(points)
    assert distance[1].isnan()
    alone, _ = field.answer(points[::2])
    assert distance[::2].tolist() == pytest.approx(alone.tolist(), abs=1e-6)


@pytest.mark.parametrize("name", KINDS)
def test_jax_answers_and_differentiates(name, jax, files):
    """Compiled; and its gradients are PyTorch's."""
    native, field = NativeField(files[name]), jax_field(files[name])
    points = points_for(native, 2000)
    distance, normal = jax.jit(field.answer)(jax.numpy.asarray(points))
    compare(native, points, np.asarray(distance), np.asarray(normal))
    points = away_from_edges(native, 500)
    found = jax.jit(jax.grad(lambda p: field.distance(p).sum()))(jax.numpy.asarray(points))
    at = torch.as_tensor(points).requires_grad_()
    torch_field(files[name]).distance(at).sum().backward()
    assert np.asarray(found) == pytest.approx(at.grad.numpy(), rel=1e-4, abs=1e-5)


def test_what_is_no_function_of_arrays_is_refused(files):
    with pytest.raises(PandisError, match="only splines and networks"):
        torch_field(files["exact"])
    with pytest.raises(ValueError, match="shape"):
        torch_field(files["spline"]).distance(torch.zeros(3))


def test_the_program_of_the_page_runs(files, capsys):
    page = (ROOT / "docs/using.md").read_text(encoding="utf-8")
    (text,) = re.findall("```python\n([^`]*torch_field.*?)```", page, re.S)
    exec(text.replace("results/bunny/export/spline-auto.pandis", str(files["spline"])), {})
    assert "tensor" in capsys.readouterr().out

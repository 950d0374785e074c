"""Tricubic B-splines: what they reproduce, how smooth they are, and how sparse ones are kept."""

import subprocess

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from pandis.engine import spline as native
from pandis.engine.spline import Lattice, SparseSpline, block_count, kept_nodes, pack
from pandis.pipeline.kinds.spline.fit import Level, Targets, fit


def inside(lattice, count, seed=0):
    reach = -lattice.low - lattice.step
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


def naive(lattice, coefficients, points):
    """The sum over all nodes of the cubic B-spline's closed form."""
    t = (points[:, None] - lattice.low) * lattice.per_step - np.arange(lattice.size)[None, :, None]
    a = np.abs(t)
    w = np.where(a < 1, (4 - 6 * a**2 + 3 * a**3) / 6, np.maximum(2 - a, 0) ** 3 / 6)
    return np.einsum("xyz,nx,ny,nz->n", coefficients, w[..., 0], w[..., 1], w[..., 2])


def test_values_are_those_of_the_basis_and_gradients_their_derivatives():
    lattice = Lattice(9, low=-1.2)
    coefficients = np.random.default_rng(1).normal(size=(9, 9, 9)).astype(np.float32)
    points = inside(lattice, 200)
    value, gradient = lattice.evaluate(coefficients, points)
    assert np.abs(value - naive(lattice, coefficients, points)).max() < 1e-13
    for k, axis in enumerate(np.eye(3)):
        ahead, behind = (naive(lattice, coefficients, points + s * 1e-5 * axis) for s in (1, -1))
        assert np.abs((ahead - behind) / 2e-5 - gradient[:, k]).max() < 1e-8


def test_cubics_are_reproduced():
    """Prefiltered by hand: for x³ the coefficient at node i is i³ - i (in steps)."""
    lattice = Lattice(12)
    i = np.arange(12.0)
    coefficients = np.broadcast_to((i**3 - i)[:, None, None], (12, 12, 12))
    points = inside(lattice, 100)
    value, gradient = lattice.evaluate(coefficients, points)
    x = (points[:, 0] + 1) * lattice.per_step
    assert np.abs(value - x**3).max() < 1e-9
    assert np.abs(gradient[:, 0] - 3 * x**2 * lattice.per_step).max() < 1e-8
    assert np.abs(gradient[:, 1:]).max() < 1e-9


def test_it_is_twice_continuous_across_cells():
    lattice = Lattice(10)
    coefficients = np.random.default_rng(2).normal(size=(10, 10, 10)).astype(np.float32)
    wall = lattice.low + 4 * lattice.step
    points = inside(lattice, 50)
    step = 1e-6
    for axis in range(3):
        sides = []
        for side in (-1, 1):
            at = points.copy()
            at[:, axis] = wall + side * 1e-9
            near = lattice.evaluate(coefficients, at)
            at[:, axis] += side * step
            beyond = lattice.evaluate(coefficients, at)
            sides.append((*near, side * (beyond[1] - near[1]) / step))
        for name, tolerance, a, b in zip("vgh", (1e-7, 1e-5, 1e-2), *sides, strict=True):
            assert np.abs(a - b).max() < tolerance, name


def test_adjoint_is_the_transpose():
    lattice = Lattice(11, low=-1.1)
    rng = np.random.default_rng(3)
    points = inside(lattice, 5000)
    c = rng.normal(size=11**3).astype(np.float32)
    v, g = rng.normal(size=5000), rng.normal(size=(5000, 3))
    value, gradient = lattice.evaluate(c.reshape(11, 11, 11), points)
    forward = value @ v + (gradient * g).sum()
    assert lattice.adjoint(points, v, g) @ c.astype(float) == pytest.approx(forward, rel=1e-10)


@pytest.mark.parametrize("threads", ["1", "3"])
def test_sums_do_not_depend_on_threads(monkeypatch, threads):
    lattice = Lattice(11)
    points = inside(lattice, 5000)
    v, g = np.sin(points[:, 0] * 9), np.cos(points * 7)
    monkeypatch.setenv("IGL_NUM_THREADS", "2")
    wanted = lattice.adjoint(points, v, g)
    monkeypatch.setenv("IGL_NUM_THREADS", threads)
    assert np.array_equal(lattice.adjoint(points, v, g), wanted)


@pytest.mark.parametrize("share", [0.05, 0.5, 1.0])
def test_sparse_is_dense_with_zeros(share):
    size = 21
    lattice = Lattice(size)
    rng = np.random.default_rng(4)
    blocks = np.zeros((block_count(size),) * 3, bool)
    blocks[:11, :11, :11] = rng.random((11, 11, 11)) < share
    masks = pack(blocks)
    nodes = kept_nodes(masks)
    coefficients = rng.normal(size=nodes.shape[:2]).astype(np.float32)
    dense = np.zeros((24, 24, 24), np.float32)
    dense[tuple(nodes.reshape(-1, 3).T)] = coefficients.reshape(-1)
    dense = dense[:size, :size, :size].copy()
    points = rng.uniform(-1.1, 1.1, (4000, 3))
    points[0] = np.nan
    value, gradient = np.ones(4000), np.full((4000, 3), 2.0)
    kept = SparseSpline(lattice, masks, coefficients).add(points, value, gradient)
    wanted_value, wanted_gradient = lattice.evaluate(dense, points)
    assert np.abs(value - 1 - wanted_value).max() < 1e-12
    assert np.abs(gradient - 2 - wanted_gradient).max() < 1e-11
    # how much is kept: count the blocks that hold the 64 nodes
    cell = np.floor((np.nan_to_num(points, nan=9) + 1) * lattice.per_step).astype(int)
    valid = ((cell >= 1) & (cell <= size - 3)).all(axis=1)
    around = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3)
    there = (cell[valid, None] - 1 + around) // 2
    found = blocks[tuple(np.moveaxis(there, -1, 0))]
    assert np.array_equal(kept[valid] == 2, found.all(axis=1))
    assert np.array_equal(kept[valid] > 0, found.any(axis=1))
    assert (kept[~valid] == 0).all()


def test_coefficients_must_match_the_masks():
    with pytest.raises(ValueError, match="differs from the number of bits"):
        SparseSpline(Lattice(8), pack(np.ones((4, 4, 4), bool)), np.zeros((63, 8), np.float32))


def test_the_source_has_no_warnings():
    source = native.__file__.replace("__init__.py", "spline.c")
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    done = subprocess.run([*command, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_fit_gives_the_same_bits_whatever_threads_blas_has():
    """With 22³ unknowns a BLAS shares an inner product out, and adds in another order."""
    lattice, rng = Lattice(22), np.random.default_rng(5)
    points = inside(lattice, 3000)
    distance = np.linalg.norm(points, axis=1)
    targets = Targets(points, distance - 0.7, points / distance[:, None], rng.random(3000))
    level = Level(lattice, np.arange(22**3))
    fits = []
    for threads in (1, 2, 4):
        with threadpool_limits(threads, user_api="blas"):
            fits.append(fit([level], [np.zeros(22**3)], targets, rounds=2, steps=4)[0])
    assert np.array_equal(fits[0], fits[1])
    assert np.array_equal(fits[0], fits[2])

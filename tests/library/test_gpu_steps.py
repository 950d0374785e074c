"""A training's steps in Warp's kernels, on its CPU or CUDA, are those that torch takes."""

import subprocess
import sys

import pytest
import torch

from pandis.pipeline.kinds.network.training import elements, exact_loss
from pandis.pipeline.kinds.network.training.network import Siren
from pandis.pipeline.run.ask.recipes import ExactRecipe
from support import ROOT, environment

warp = pytest.importorskip("warp", reason="no Warp: pip install warp-lang")
from pandis.engine.cuda import steps  # noqa: E402 (needs Warp)

DEVICES = ["cpu", *(["cuda"] if warp.is_cuda_available() else [])]


@pytest.fixture(params=DEVICES)
def device(request):
    return request.param


def gradients(outputs, columns, device, kernels, monkeypatch):
    """Return the loss and its gradients by all parameters, with those kernels or with torch's."""
    for module in (elements, exact_loss):
        monkeypatch.setattr(module, "fused", lambda values: kernels)
    generator = torch.Generator().manual_seed(0)
    network = Siren(24, 3, 20.0, outputs=outputs, generator=generator).to(device)
    rows = (torch.rand(500, columns, generator=generator) * 2 - 1).to(device)
    rows[0, 3] = 0.0
    output, gradient = network(rows[:, :3]), None
    if outputs == 1:
        output, gradient = network.forward_with_gradient(rows[:, :3])
    loss = exact_loss.loss_of((output, gradient), rows, ExactRecipe(steps=1))
    return loss, torch.autograd.grad(loss, list(network.parameters()))


FIRST = """
import torch
from pandis.engine.cuda import steps
z, bias, cosine = torch.zeros(3, 5), torch.zeros(3), torch.zeros(3, 5)
steps.launch(steps.sines, z.shape, z, bias, cosine)
assert (cosine == 1).all()
"""


def test_a_kernel_may_be_the_first_that_warp_is_asked_for():
    """A closed form has its labels from the host, so that nothing has woken Warp before."""
    path = environment(PYTHONPATH=str(ROOT / "workflow"))
    done = subprocess.run([sys.executable, "-c", FIRST], env=path, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()


def test_without_warp_or_its_gpu_torch_takes_the_steps(monkeypatch):
    elements._kernels.cache_clear()
    monkeypatch.setattr(steps.wp, "is_cuda_available", lambda: False)
    assert elements._kernels() is None
    elements._kernels.cache_clear()
    monkeypatch.setitem(sys.modules, "pandis.engine.cuda.steps", None)
    assert elements._kernels() is None
    elements._kernels.cache_clear()


@pytest.mark.parametrize("outputs", [1, 4], ids=["gradient", "outputs"])
@pytest.mark.parametrize("columns", [7, 11], ids=["alone", "with a base"])
def test_a_step_is_that_of_torch(outputs, columns, device, monkeypatch):
    loss, wanted = gradients(outputs, columns, device, None, monkeypatch)
    other, seen = gradients(outputs, columns, device, steps, monkeypatch)
    assert other.item() == pytest.approx(loss.item(), rel=1e-6)
    for ours, torchs in zip(seen, wanted, strict=True):
        assert (ours - torchs).abs().max() < 2e-6 * max(1.0, torchs.abs().max())
        assert torchs.abs().max() > 0

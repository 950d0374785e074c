import math
import subprocess
import sys

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT, Frame
from pandis.base.progress import Context
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.geometry.strata import Strata
from pandis.pipeline.kinds.network.spec import TrainTask
from pandis.pipeline.kinds.network.training import exact_loss, vectors
from pandis.pipeline.kinds.network.training import paper_loss as losses
from pandis.pipeline.kinds.network.training import trainer as trainer_module
from pandis.pipeline.kinds.network.training.batches import TrainingPoints, vertex_points
from pandis.pipeline.kinds.network.training.elements import sines
from pandis.pipeline.kinds.network.training.network import Siren
from pandis.pipeline.kinds.network.training.optimiser import Optimiser, orthogonal
from pandis.pipeline.kinds.network.training.products import product
from pandis.pipeline.kinds.network.training.trainer import Trainer
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.ask.recipes import ExactRecipe, PaperRecipe
from pandis.pipeline.run.job.stage import silent_progress
from support import ROOT, artifact, environment, sample


@pytest.fixture(scope="module")
def samples():
    body = Body(*SHAPES["sphere"].tessellation(), Frame((0.0, 0.0, 0.0), 0.9), shape="sphere")
    options = SampleOptions(
        surface=4000, offsets=4000, scales=[0.01, 0.05], shallow=4000, penetration=4000,
        depth=0.05, bent=0, core=500, box=2000, held_out=2000,
    )  # fmt: skip
    drawn = artifact("samples", *sample(body, options, 1, silent_progress))
    return TrainingPoints(drawn, Strata(body, options, 1))


def recipe(loss="exact", **options):
    model = PaperRecipe if loss == "paper" else ExactRecipe
    small = {"width": 24, "depth": 2, "steps": 60, "batch": 256, "threads": 1}
    return model(**small | options)


def task(seed=7, **options):
    return TrainTask(kind="network", name="r", recipe=recipe(**options), seed=seed)


def trainer(samples, tmp_path, **options):
    return Trainer(
        task(**options), samples, Context(tmp_path / "c.pt", silent_progress, lambda text: None)
    )


def same(one, other):
    return all(np.array_equal(one[0][k], other[0][k]) for k in one[0]) and one[1] == other[1]


# --- the network ----------------------------------------------------------------------


def plain(network, points):
    """The network in autograd's own operations."""
    h = points
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        h = torch.sin(network.omega * torch.nn.functional.linear(h, weight, bias))
    return torch.nn.functional.linear(h, network.weights[-1], network.biases[-1])


@pytest.mark.parametrize("outputs", [1, 4])
def test_hand_written_gradient_is_autograds(outputs):
    network = Siren(
        20, 3, 30.0, outputs=outputs, generator=torch.Generator().manual_seed(0)
    ).double()
    points = torch.rand(50, 3, dtype=torch.float64).requires_grad_()
    output, gradient = network.forward_with_gradient(points)
    (wanted,) = torch.autograd.grad(plain(network, points)[:, 0].sum(), points)
    assert torch.allclose(gradient, wanted, atol=1e-13)
    assert torch.allclose(output, plain(network, points), atol=1e-13)
    assert torch.equal(output, network(points))


@pytest.mark.parametrize("depth", [1, 2, 4])
@pytest.mark.parametrize("outputs", [1, 4])
def test_hand_written_backward_is_that_of_double_backward(depth, outputs):
    network = Siren(
        12, depth, 30.0, outputs=outputs, generator=torch.Generator().manual_seed(0)
    ).double()
    points = torch.rand(30, 3, dtype=torch.float64).requires_grad_()

    def loss(output, gradient):
        return losses.eikonal(gradient) + (output**2).mean() + (output[:, :1] * gradient).mean()

    loss(*network.forward_with_gradient(points)).backward()
    by_hand = [gradient_of(p) for p in network.parameters()]
    network.zero_grad()
    output = plain(network, points)
    (gradient,) = torch.autograd.grad(output[:, 0].sum(), points, create_graph=True)
    loss(output, gradient).backward()
    for ours, parameter in zip(by_hand, network.parameters(), strict=True):
        assert torch.allclose(ours, gradient_of(parameter), atol=1e-10)
    assert sum(g.abs().sum() for g in by_hand) > 0
    network.zero_grad()
    network(points).square().mean().backward()  # without the gradient by the position
    by_hand = [gradient_of(p) for p in network.parameters()]
    network.zero_grad()
    plain(network, points).square().mean().backward()
    for ours, parameter in zip(by_hand, network.parameters(), strict=True):
        assert torch.allclose(ours, gradient_of(parameter), atol=1e-12)


def test_sines_are_sines_whatever_the_threads():
    z = torch.linspace(-300, 300, 9001).repeat(5, 1)
    bias = torch.tensor([0.0, 1.0, -2.0, 100.0, 1e-6])
    exact = (z + bias[:, None]).double()
    found = []
    for threads in (1, 2, 4):
        torch.set_num_threads(threads)
        found.append(sines(z.clone(), bias))
    torch.set_num_threads(1)
    for sine, cosine in found:
        assert (sine - exact.sin()).abs().max() < 1.5e-7
        assert (cosine - exact.cos()).abs().max() < 1.5e-7
        assert torch.equal(sine, found[0][0])
        assert torch.equal(cosine, found[0][1])


def test_sines_of_what_is_no_number_are_none():
    z = torch.tensor([[torch.nan, torch.inf, -torch.inf, 0.5]])
    for part in sines(z.clone(), torch.zeros(1)):
        assert part.isnan().tolist() == [[True, True, True, False]]


def test_products_are_products():
    a, b = torch.randn(37, 64), torch.randn(64, 129)
    assert torch.allclose(product(a, b), a @ b, atol=1e-4)
    assert torch.allclose(product(a.T.contiguous(), a), a.T @ a, atol=1e-4)


def test_orthogonal_step_has_singular_values_near_one():
    matrices = torch.randn(3, 40, 40, generator=torch.Generator().manual_seed(0))
    together = orthogonal(matrices)
    for matrix, turned in zip(matrices, together, strict=True):
        assert torch.linalg.matrix_norm(turned, 2) < 1.3
        assert turned.norm() ** 2 / 40 > 0.6
        torch.testing.assert_close(turned, orthogonal(matrix[None])[0])


def gradient_of(parameter):
    return torch.zeros_like(parameter) if parameter.grad is None else parameter.grad.clone()


def test_adam_is_torchs_bit_for_bit():
    """With other rates at every step, and from a checkpoint of either."""
    generator = torch.Generator().manual_seed(0)
    network = Siren(32, 3, 15.0, outputs=4, generator=generator)
    copies = [p.detach().clone().requires_grad_() for p in network.parameters()]
    optimiser, theirs = Optimiser(network, 1e-2, None), torch.optim.Adam(copies, fused=True)
    for step in range(20):
        optimiser.set_share(1 / (1 + step))
        theirs.param_groups[0]["lr"] = 1e-2 / (1 + step)
        for one, other in zip(network.parameters(), copies, strict=True):
            one.grad = torch.randn(one.shape, generator=generator)
            other.grad = one.grad.clone()
        optimiser.step(), theirs.step()
        for one, other in zip(network.parameters(), copies, strict=True):
            assert torch.equal(one, other)
        if step == 9:
            optimiser.restore({"adam": theirs.state_dict(), "momenta": []})
    stored, wanted = optimiser.state()["adam"]["state"], theirs.state_dict()["state"]
    for index, values in wanted.items():
        assert all(torch.equal(stored[index][key], value) for key, value in values.items())


def test_a_training_does_not_load_torchs_compiler():
    """It takes seconds, longer than a short training on a GPU."""
    program = (
        "import sys, torch\n"
        "from pandis.pipeline.kinds.network.training.network import Siren\n"
        "from pandis.pipeline.kinds.network.training import trainer\n"
        "network = Siren(16, 2, 15.0, outputs=1, generator=torch.Generator())\n"
        "trainer.Optimiser(network, 1e-3, 0.05)\n"
        "assert 'torch._dynamo' not in sys.modules and 'sympy' not in sys.modules\n"
    )
    command = [sys.executable, "-c", program]
    subprocess.run(command, env=environment(PYTHONPATH=str(ROOT / "workflow")), check=True)


def test_initialisation_is_sirens():
    network = Siren(256, 4, 30.0, outputs=4, generator=torch.Generator().manual_seed(0))
    assert network.weights[0].abs().max() <= 1 / 3
    for weight in network.weights[1:]:
        assert weight.abs().max() <= math.sqrt(6 / 256) / 30
    assert network.weights[1].std().item() == pytest.approx(math.sqrt(2 / 256) / 30, rel=0.02)
    assert sum(p.numel() for p in network.parameters()) == 199_428


# --- the losses -------------------------------------------------------------------------


def rows(*values):
    return torch.tensor(values, dtype=torch.float64)


def test_each_term_by_hand():
    g = rows([2.0, 0, 0], [0, 0.5, 0])
    n = rows([1.0, 0, 0], [1.0, 0, 0])
    near = {"abs": 1e-6}
    assert losses.eikonal(g).item() == pytest.approx((1 + 0.5) / 2, **near)
    assert losses.normal_alignment(g, n).item() == pytest.approx((0 + 1) / 2, **near)
    assert losses.surface(rows(-0.1, 0.3)).item() == pytest.approx(0.2)
    phi = rows(0.0, -0.01)
    assert losses.off_surface(phi, 100.0).item() == pytest.approx((1 + math.exp(-1)) / 2)
    assert losses.unit_length(rows([0.0, 3, 4])).item() == pytest.approx(4, **near)
    assert losses.psi_on_surface(-n, n).item() == pytest.approx(2, **near)
    assert losses.psi_off_surface(g, n).item() == pytest.approx(0.5, **near)


def test_total_is_the_weighted_sum():
    on, off = rows([0.1, 1, 0, 0]), rows([0.02, 0, 2, 0])
    g_on, g_off = rows([0.0, 3, 0]), rows([1.0, 1, 0])
    options = recipe("paper")
    total = losses.paper_loss(
        on, g_on, off, off_gradient=g_off, normal=rows([1.0, 0, 0]), options=options
    ).item()
    by_hand = (
        50 * (2 + math.sqrt(2) - 1) / 2 + 100 * 1 + 3000 * 0.1 + 100 * math.exp(-2)
        + 50 * (0 + 1) / 2 + 100 * 0 + 100 * (1 - 1 / math.sqrt(2))
    )  # fmt: skip
    assert total == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize(("on", "off"), [(1, 1), (3, 1)])
def test_a_mean_over_the_whole_batch_is_one_with_zeros_where_a_term_does_not_hold(on, off):
    """SIREN's code: torch.where(on the surface, term, 0).mean()."""
    here = torch.arange(on)[:, None] + rows([0.1, 1, 0.5, 0])
    there, n = rows([0.02, 0, 2, 0]).repeat(off, 1), rows([1.0, 0, 0]).repeat(on, 1)
    g_here, g_there = rows([0.5, 3, 0]).repeat(on, 1), rows([1.0, 1, 0]).repeat(off, 1)
    given = {"off_gradient": g_there, "normal": n}
    total = losses.paper_loss(
        here, g_here, there, **given, options=recipe("paper", weighting="batch")
    ).item()
    zeros_on, zeros_off = torch.zeros(on), torch.zeros(off)
    gradient = torch.cat([g_here, g_there])
    each = [
        (vectors.length(gradient) - 1).abs(),
        torch.cat([1 - vectors.cosine(g_here, n), zeros_off]),
        torch.cat([here[:, 0].abs(), zeros_off]),
        torch.cat([zeros_on, torch.exp(-100 * there[:, 0].abs())]),
        (vectors.length(torch.cat([here[:, 1:], there[:, 1:]])) - 1).abs(),
        torch.cat([1 - vectors.cosine(here[:, 1:], n), zeros_off]),
        torch.cat([zeros_on, 1 - vectors.cosine(there[:, 1:], g_there)]),
    ]
    by_hand = sum(w * t.mean() for w, t in zip(recipe("paper").weights, each, strict=True))
    assert total == pytest.approx(by_hand.item(), rel=1e-9)
    subset = losses.paper_loss(here, g_here, there, **given, options=recipe("paper")).item()
    assert subset > total  # four of the terms weigh more there


def test_stop_gradient_keeps_psi_from_training_phi():
    for stop in (True, False):
        g = rows([1.0, 1, 0]).requires_grad_()
        options = recipe("paper", weights=[0, 0, 0, 0, 0, 0, 100.0], stop_gradient=stop)
        one = rows([0.0, 1, 0, 0])
        losses.paper_loss(
            one, rows([1.0, 0, 0]), one, off_gradient=g, normal=rows([1.0, 0, 0]), options=options
        ).backward()
        assert (g.grad is None or not g.grad.any()) == stop


def test_no_term_is_unbounded_below():
    """With raw inner products a growing Ψ would be rewarded without limit."""
    n = rows([1.0, 0, 0])
    for size in (1e-3, 1.0, 1e3, 1e6):
        assert losses.psi_on_surface(size * n, n).item() >= 0
        total = 50 * losses.unit_length(size * n) + 100 * losses.psi_on_surface(size * n, n)
        assert total.item() >= 0


def test_gradients_are_finite_at_zero():
    for term in (
        losses.eikonal,
        losses.unit_length,
        lambda v: losses.psi_on_surface(v, rows([1.0, 0, 0])),
        lambda v: losses.psi_off_surface(rows([1.0, 0, 0]), v),
    ):
        zero = rows([0.0, 0, 0]).requires_grad_()
        term(zero).backward()
        assert torch.isfinite(zero.grad).all()
        assert zero.grad.abs().max() <= 1.1 / vectors.SMALL


def test_off_surface_term_makes_no_subnormals():
    phi = torch.tensor([1.0, 0.9, 2.0, 1e6], requires_grad=True)
    losses.off_surface(phi, 100.0).backward()
    assert losses.off_surface(phi, 100.0).item() < 1e-30
    tiny = torch.finfo(torch.float32).tiny
    assert all(g == 0 or abs(g) > tiny for g in phi.grad.tolist())


def test_exact_loss_is_zero_at_the_truth_and_counts_force():
    options = recipe()
    distance, normal = rows(-0.02, 0.0), rows([1.0, 0, 0], [0, 1.0, 0])
    floor = exact_loss.exact_loss(distance, normal, distance, normal=normal, options=options).item()
    assert floor == pytest.approx(0, abs=1e-5)
    off = exact_loss.exact_loss(
        distance + 0.01, normal, distance, normal=normal, options=options
    ).item()
    assert off == pytest.approx(0.01 * (0.5 + 1) / 2, rel=1e-3)
    turned = exact_loss.exact_loss(
        distance, normal.flip(0), distance, normal=normal, options=options
    ).item()
    assert turned == pytest.approx(options.normal_weight * 2**0.5 * 0.75, rel=1e-3)


# --- the trainer ---------------------------------------------------------------------------


@pytest.mark.parametrize("direction", ["output", "gradient"])
@pytest.mark.parametrize("loss", ["exact", "paper"])
def test_training_learns_and_reproduces(samples, tmp_path, loss, direction):
    options = {"loss": loss, "direction": direction, "steps": 150}
    one = trainer(samples, tmp_path, **options).run()
    other = trainer(samples, tmp_path, **options).run()
    assert same(one, other)
    curve = one[0]["curve"]
    assert curve[-1, 1] < 0.7 * curve[0, 1]
    assert one[1]["reproducible"]
    assert one[1]["steps"] == 150
    assert one[1]["held_out_error"]["mean"] < 0.03


@pytest.mark.parametrize("loss", ["exact", "paper"])
def test_resumed_run_ends_bit_identical(samples, tmp_path, loss):
    """Interrupt a run at every tenth step; the checkpoint alone carries it on."""
    undisturbed = trainer(samples, tmp_path, loss=loss).run()

    class Interrupted(Exception):
        pass

    result, stops = None, 0
    while result is None:
        run = trainer(samples, tmp_path, loss=loss)
        advance, left = run._advance, iter(range(10))

        def interrupt(share, run=run, advance=advance, left=left):
            if next(left, None) is None:
                run.good = run._state()
                run._save()
                raise Interrupted
            return advance(share)

        run._advance = interrupt
        try:
            result = run.run()
        except Interrupted:
            stops += 1
    assert stops >= 5
    assert same(result, undisturbed)
    run.finish()
    assert not (tmp_path / "c.pt").exists()


def test_damaged_checkpoint_starts_afresh(samples, tmp_path):
    undisturbed = trainer(samples, tmp_path).run()
    (tmp_path / "c.pt").write_bytes(b"half a checkpoint")
    assert same(trainer(samples, tmp_path).run(), undisturbed)


def test_seed_and_options_matter(samples, tmp_path):
    one = trainer(samples, tmp_path).run()
    context = Context(tmp_path / "c.pt", silent_progress, print)
    assert not same(one, Trainer(task(seed=8), samples, context).run())


def test_numbers_after_a_training_are_those_of_before(samples, tmp_path):
    """A step takes subnormals for zeros; a k-d tree that met that would divide for ever."""
    least = np.full(1, np.nextafter(0.0, 1.0))
    trained = trainer(samples, tmp_path, steps=3)
    assert (least > 0).all()
    trained.run()
    assert (least > 0).all()


def test_budget_in_seconds_records_its_steps(samples, tmp_path):
    arrays, attributes = trainer(samples, tmp_path, steps=None, seconds=0.5).run()
    assert not attributes["reproducible"]
    assert attributes["steps"] >= 1  # how many, the clock decides
    assert np.isfinite(arrays["weight_0"]).all()


def test_divergence_is_an_error_not_a_field(samples, tmp_path):
    wild = trainer(samples, tmp_path, learning_rate=1e30, warmup=0.0)
    with pytest.raises(PandisError, match=r"diverged.*train\.r\.learning_rate"):
        wild.run()
    late = trainer(samples, tmp_path, steps=None, seconds=0.2)  # between two points of the curve
    with torch.no_grad():
        late.parameters[0][0, 0] = torch.nan
    with pytest.raises(PandisError, match="diverged"):
        late.run()


@pytest.mark.parametrize("harm", ["nan", "wild"])
def test_divergence_restarts_from_the_last_good_state(samples, tmp_path, harm):
    lines = []
    run = Trainer(
        task(steps=200), samples, Context(tmp_path / "c.pt", silent_progress, lines.append)
    )
    advance, done = run._advance, []

    def harmed(share):
        loss = advance(share)
        if run.step == 120 and not done:
            done.append(run.step)
            with torch.no_grad():
                run.parameters[1].mul_(torch.nan if harm == "nan" else 30.0)
        return loss

    run._advance = harmed
    arrays, attributes = run.run()
    assert attributes["restarts"] == 1
    assert attributes["steps"] == 200
    assert any("diverged at step 120" in line for line in lines)
    assert attributes["held_out_error"]["mean"] < 1.1 * arrays["curve"][:, 2].min()
    assert (np.diff(arrays["curve"][:, 0]) > 0).all()


def test_a_base_that_is_all_but_right_is_no_reason_to_restart(samples, tmp_path):
    run = trainer(samples, tmp_path)
    run.least = 1e-3 * run.force
    assert not run._diverged(0.5, 0.09 * run.force)  # ninety times worse, and still good
    assert run._diverged(0.5, 0.11 * run.force)


def test_checkpoint_that_cannot_be_written_does_not_stop_the_run(samples, tmp_path, monkeypatch):
    monkeypatch.setattr("pandis.pipeline.kinds.network.training.trainer.CHECKPOINT_SECONDS", 0.0)
    (tmp_path / "file").write_text("in the way")
    lines = []
    run = Trainer(
        task(steps=5), samples, Context(tmp_path / "file" / "c.pt", silent_progress, lines.append)
    )
    assert run.run()[1]["steps"] == 5
    assert any("no checkpoint at step" in line for line in lines)


def test_every_batch_is_new_and_none_is_held_out(samples, tmp_path):
    held_out = samples[0].arrays["points"][slice(*samples[0].attributes["strata"]["held-out"])]
    stored = {tuple(row) for row in samples[0].arrays["points"].tolist()}
    batches = trainer(samples, tmp_path).batches
    # the first steps, the last of the first block and one of the next
    steps = [0, 1, 2, batches.per_block - 1, batches.per_block, 7 * batches.per_block + 5]
    shown = [tuple(row) for step in steps for row in batches.batch(step)[:, :3].tolist()]
    assert len(set(shown)) == len(shown) == 256 * len(steps)
    assert not set(shown) & stored
    assert {tuple(row) for row in held_out.tolist()} <= stored
    again = trainer(samples, tmp_path).batches
    assert torch.equal(again.batch(steps[-1]), batches.batch(steps[-1]))


def test_paper_is_shown_the_surface_and_the_box(samples, tmp_path):
    rows = trainer(samples, tmp_path, loss="paper").batches.batch(20)
    assert rows.shape == (256, 10)
    assert not rows[:, 3].any()
    assert torch.allclose(rows[:, :3].norm(dim=1), torch.tensor(0.9), atol=1e-6)
    assert rows[:, 7:].abs().max() <= 1


def test_paper_is_shown_vertices_with_their_own_normals(samples, tmp_path):
    run = trainer(samples, tmp_path, loss="paper", points="vertices")
    shown = np.concatenate([run.batches.batch(k)[:, :7] for k in range(run.batches.per_block)])
    vertices = samples[1].body.surface.vertices
    onto = 0.9 * vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    assert cKDTree(onto).query(shown[:, :3])[0].max() < 1e-6
    assert len(np.unique(shown[:, :3], axis=0)) == len(shown) > 0.9 * len(vertices)
    np.testing.assert_allclose(shown[:, 4:7], shown[:, :3] / 0.9, atol=1e-6)
    assert not shown[:, 3].any()


def test_normal_of_a_vertex_is_that_of_its_faces_by_angle():
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1]], float) - 0.3
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = vertex_points(Body(vertices, faces, UNIT))
    np.testing.assert_allclose(found[:, :3], vertices, atol=1e-7)
    for k, row in enumerate(found):
        total = np.zeros(3)
        for face in faces[(faces == k).any(axis=1)]:
            at = np.roll(face, -np.flatnonzero(face == k)[0])
            a, b = vertices[at[1]] - vertices[k], vertices[at[2]] - vertices[k]
            angle = np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
            normal = np.cross(a, b)
            total += angle * normal / np.linalg.norm(normal)
        np.testing.assert_allclose(row[4:7], total / np.linalg.norm(total), atol=1e-6)


@pytest.mark.parametrize("direction", ["output", "gradient"])
def test_paper_adds_to_a_base_what_it_answers_with(samples, tmp_path, direction):
    """What the loss sees, Φ, ∇Φ and Ψ at both halves of a batch, is what the field answers."""
    run = trainer(samples, tmp_path, loss="paper", base=8, direction=direction)
    batch, seen = run.batches.batch(3), []

    def paper_loss(*rows, off_gradient, **options):
        seen.append((*rows, off_gradient))

    losses_of, trainer_module.paper_loss = trainer_module.paper_loss, paper_loss
    try:
        run._loss(batch)
    finally:
        trainer_module.paper_loss = losses_of
    on, on_gradient, off, off_gradient = (part.detach() for part in seen[0][:4])
    for points, phi, gradient in (
        (batch[:, :3], on, on_gradient),
        (batch[:, 7:10], off, off_gradient),
    ):
        empty = np.zeros(len(points)), np.zeros((len(points), 3))
        known = run._rows_of(points.numpy(), *empty)
        with torch.no_grad():
            wanted, psi = run._answer(known)
        torch.testing.assert_close(phi[:, 0], wanted, atol=1e-5, rtol=0)
        psi_seen = gradient if direction == "gradient" else phi[:, 1:]
        torch.testing.assert_close(psi_seen, psi, atol=1e-4, rtol=0)
        away = gradient * points / points.norm(dim=1, keepdim=True)
        assert away.sum(dim=1).mean() > 0.5  # a sketch of the distance before any step


def test_schedule_is_an_option_of_both_recipes(samples, tmp_path):
    shares = (0.0, 0.01, 0.02, 0.5, 1.0)
    for loss in ("paper", "exact"):
        constant = trainer(samples, tmp_path, loss=loss, schedule="constant")
        assert {constant._rate(share) for share in shares} == {1.0}
        cosine = trainer(samples, tmp_path, loss=loss, schedule="cosine")
        rates = [cosine._rate(share) for share in shares]
        assert rates[0] < rates[1] < rates[2] > rates[3] > rates[4] == pytest.approx(0, abs=1e-9)
        assert rates[2] == pytest.approx(1.0, abs=1e-2)


def test_fewer_points_than_a_batch(samples, tmp_path):
    run = trainer(samples, tmp_path, loss="paper", batch=10_000, steps=3)
    assert run.run()[1]["steps"] == 3


def test_cuda_that_is_not_there_is_refused(samples, tmp_path):
    if torch.cuda.is_available():
        assert trainer(samples, tmp_path, device="cuda").device == "cuda"
    else:
        with pytest.raises(PandisError, match="finds no CUDA device"):
            trainer(samples, tmp_path, device="cuda")
    assert trainer(samples, tmp_path, device="cpu").device == "cpu"

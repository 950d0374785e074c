"""Training: steps, schedule, checkpoints, restarts, held-out error."""

import contextlib
import copy
import math
import time
from pathlib import Path

import numpy as np
import torch

from pandis.base.errors import PandisError
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.record import Architecture, Error, ModelRecord, Spread
from pandis.pipeline.kinds.network.training.batches import (
    answer,
    area_points,
    fresh_batches,
    surface_batches,
    vertex_points,
    with_base,
)
from pandis.pipeline.kinds.network.training.elements import fused
from pandis.pipeline.kinds.network.training.exact_loss import loss_of
from pandis.pipeline.kinds.network.training.interrupts import noted
from pandis.pipeline.kinds.network.training.labels import on_device, own_stream
from pandis.pipeline.kinds.network.training.network import Siren, named_arrays, usual_omega
from pandis.pipeline.kinds.network.training.optimiser import Optimiser
from pandis.pipeline.kinds.network.training.paper_loss import paper_loss
from pandis.pipeline.kinds.network.training.products import keep_freed_memory
from pandis.pipeline.kinds.network.training.recording import RecordedStep
from pandis.pipeline.run.records.samples import SamplesRecord

CHECKPOINT_SECONDS = 20.0
CURVE_POINTS = 100
QUICK = 4000
#: Once the fraction EARLY of the budget is used, a run has diverged if its error exceeds DIVERGED
#: times the smallest so far and HARMLESS times the mean force: a base may be nearly exact at first.
DIVERGED, EARLY, HARMLESS = 4.0, 0.05, 0.1
RESTARTS = 5
#: Options that set the requested accuracy and do not affect how a network is trained.
_NOT_OF_A_TRAINING = {"force_error", "tail", "missed"}


@contextlib.contextmanager
def _subnormals_as_zero():
    """Treat subnormal numbers as zero on this thread while the body runs.

    Processors are many times slower on subnormal numbers. Other code must not run with this
    setting: SciPy's k-d tree, for example, then splits a node forever.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


class Trainer:
    """Trains one network; the same options and samples give the same bytes.

    A step depends only on the seed and its own number, so a run resumed from a checkpoint gives the
    same result as an uninterrupted one.

    Parameters
    ----------
    task : pandis.pipeline.kinds.network.spec.TrainTask
    points : pandis.pipeline.kinds.network.training.batches.TrainingPoints
    context : pandis.base.progress.Context
    """

    def __init__(self, task, points, context):
        options, seed, (samples, strata) = task.recipe, task.seed, points
        self.context, self.log = context, context.log
        torch.set_num_threads(options.threads)
        keep_freed_memory()
        torch.backends.cuda.matmul.allow_tf32 = False
        self.name, self.options, self.checkpoint = task.name, options, Path(context.checkpoint)
        self.device = self._pick_device(options.device)
        self.paper, self.own_gradient = options.loss == "paper", options.direction == "gradient"
        batch = options.batch
        self.base = fit_base(strata.engine, options.base) if options.base else None
        if self.paper:
            if options.points == "vertices":
                places = vertex_points(strata.body)
            else:
                places = area_points(samples)
            self.batches = surface_batches(places, self.base, batch, seed=seed, device=self.device)
        else:
            engine = on_device(strata.engine, self.device, self.log)
            self.batches = fresh_batches(
                strata.asking(engine), self.base, batch, seed=seed, device=self.device
            )
        low, high = SamplesRecord.of(samples).strata["held-out"]
        columns = [samples.arrays[k][low:high] for k in ("points", "distance", "normal")]
        self.held_out = self._rows_of(*columns)
        self.force = float(np.maximum(-columns[1], 0).mean())
        generator = torch.Generator().manual_seed(seed)
        self.shape = Architecture(
            width=options.width,
            depth=options.depth,
            omega=options.omega or usual_omega(options.width),
            outputs=1 if self.own_gradient else 4,
        )
        self.network = Siren(**dict(self.shape), generator=generator).to(self.device)
        self.parameters = list(self.network.parameters())
        self.optimiser = Optimiser(self.network, options.learning_rate, options.matrix_rate)
        self.step, self.elapsed, self.curve = 0, 0.0, []
        self.slowdown, self.restarts, self.least, self.good = 1.0, 0, math.inf, None
        self._recorded = RecordedStep(self._descend)

    def _pick_device(self, name):
        if name == "cuda" and not torch.cuda.is_available():
            raise PandisError(
                "train: device is 'cuda', but torch finds no CUDA device; set it to 'auto' or 'cpu'"
            )
        return "cuda" if name != "cpu" and torch.cuda.is_available() else "cpu"

    # --- one step ----------------------------------------------------------------

    def _outputs(self, rows):
        """Return the outputs (n, 4) or (n, 1), and the gradient (n, 3) if it is the direction."""
        if self.own_gradient:
            return self.network.forward_with_gradient(rows[:, :3])
        return self.network(rows[:, :3]), None

    def _answer(self, rows):
        return answer(*self._outputs(rows), rows)

    def _loss(self, rows):
        if not self.paper:
            return loss_of(self._outputs(rows), rows, self.options)
        points, normal, n = rows[:, :3], rows[:, 4:7], len(rows)
        output, gradient = self.network.forward_with_gradient(torch.cat([points, rows[:, 7:10]]))
        if self.base is not None:
            known = torch.cat([rows[:, 10:14], rows[:, 14:18]])
            # the base's value is added to Φ, and its gradient to Ψ if that is an output
            output = output + known[:, : output.shape[1]]
            gradient = gradient + known[:, 1:]
        return paper_loss(
            output[:n],
            gradient[:n],
            output[n:],
            off_gradient=gradient[n:],
            normal=normal,
            options=self.options,
        )

    def _rate(self, share):
        """Return the step size, relative to the largest, at a given fraction of the budget.

        The step size is constant, or rises in a warm-up and then falls to zero along half a cosine.
        """
        if self.options.schedule == "constant":
            return self.slowdown
        warmup = self.options.warmup
        if share < warmup:
            return self.slowdown * (share / warmup + 1e-3)
        return self.slowdown * 0.5 * (1 + math.cos(math.pi * (share - warmup) / (1 - warmup)))

    def _descend(self, rows):
        loss = self._loss(rows)
        gradients = torch.autograd.grad(loss, self.parameters)
        for parameter, gradient in zip(self.parameters, gradients, strict=True):
            parameter.grad = gradient
        if self.options.clip:
            torch.nn.utils.clip_grad_norm_(self.parameters, self.options.clip)
        self.optimiser.step()
        return loss.detach()

    def _advance(self, share):
        self.optimiser.set_share(self._rate(share))
        rows = self.batches.batch(self.step)
        if self.device == "cuda":
            loss = self._recorded(rows)
        else:
            with _subnormals_as_zero():
                loss = self._descend(rows)
        self.step += 1
        return loss

    # --- the run -----------------------------------------------------------------

    def run(self):
        """Train to the end of the budget.

        Returns
        -------
        arrays, attributes : dict
            As stored in ``model-….zarr.zip``.

        Raises
        ------
        PandisError
            The run diverged repeatedly.
        KeyboardInterrupt
            The process was asked to stop. A checkpoint of the last step has been written.
        """
        steps, seconds = self.options.steps, self.options.seconds
        report = self.context.progress(
            "training", steps or seconds, "steps" if steps else "seconds"
        )
        self._resume()
        report.resume(self.step if steps else self.elapsed)
        with noted() as interrupted, own_stream(self.device):
            if self.device == "cuda":  # load kernels before the budget starts
                if not fused(self.parameters[0]):
                    self.log("steps take longer without Warp: pip install warp-lang")
                torch.autograd.grad(self._loss(self.batches.batch(self.step)), self.parameters)
                self._offs(self.held_out[:QUICK]).mean().item()
            note = self._until(steps, seconds, report, interrupted=interrupted)
        result = self._result()
        self.log(f"{self.step} steps in {self.elapsed:.1f} s on {self.device}; {note}")
        return result

    def _until(self, steps, seconds, report, *, interrupted):
        """Train until the budget is used up; return a note of the last measured loss and error."""
        start, saved = time.monotonic() - self.elapsed, time.monotonic()
        every = max(1, steps // CURVE_POINTS) if steps else 50
        note = ""
        while True:
            self.elapsed = time.monotonic() - start
            done = self.step if steps else self.elapsed
            if done >= (steps or seconds):
                return note
            share = done / (steps or seconds)
            loss = self._advance(share)
            if self.step % every == 0:
                # on a GPU all of this is queued before the first wait
                state, finite = self._state(), self._finite()
                error = self._offs(self.held_out[:QUICK]).mean()
                value, error, finite = torch.stack([loss, error, finite]).tolist()
                if not finite or self._diverged(share, error):
                    self._restart()
                    continue
                self.curve.append((self.step, value, error))
                self.least = min(self.least, error)
                self.good = state | {"curve": list(self.curve), "least": self.least}
                note = f"loss {value:.4g}, held-out force error {error:.3e}"
                if time.monotonic() - saved > CHECKPOINT_SECONDS:
                    self._save()
                    saved = time.monotonic()
            report.update(self.step if steps else time.monotonic() - start, note)
            if interrupted():
                if self._finite():
                    self.good = self._state()
                    self._save()
                raise KeyboardInterrupt

    def keep(self):
        """Save the current state, so that a later run need not train again."""
        self.good = self._state()
        self._save()

    def finish(self):
        """Remove the checkpoints, even those of older options, once the artifact is written."""
        for path in self.checkpoint.parent.glob(f"{self.checkpoint.name.split('.')[0]}.*pt"):
            path.unlink()
        with contextlib.suppress(OSError):  # it may contain checkpoints of other recipes
            self.checkpoint.parent.rmdir()

    # --- divergence ----------------------------------------------------------------

    def _diverged(self, share, error):
        # the paper's loss is not checked: it uses no distances, and its error rises and falls
        harmful = max(DIVERGED * self.least, HARMLESS * self.force)
        return not self.paper and share > EARLY and error > harmful

    def _finite(self):
        return torch.stack([torch.isfinite(p).all() for p in self.parameters]).all()

    def _restart(self):
        """Restore the last good state, and halve the step size."""
        at, self.restarts = self.step, self.restarts + 1
        if self.good is None or self.restarts > RESTARTS:
            self.checkpoint.unlink(missing_ok=True)
            raise self._divergence(f"{self.restarts} times, the last at step {at}")
        slowdown, restarts = self.slowdown / 2, self.restarts
        self._restore(self.good)
        self.slowdown, self.restarts = slowdown, restarts
        self.log(
            f"warning: diverged at step {at}; continues from step {self.step} at half the step size"
        )

    def _divergence(self, how):
        return PandisError(
            f"training diverged {how}; reduce train.{self.name}.learning_rate "
            f"(now {self.options.learning_rate:g}), or set clip"
        )

    # --- the result ------------------------------------------------------------------

    def _result(self):
        if not self._finite():
            raise self._divergence(f"at step {self.step}: the network's weights are not finite")
        arrays = named_arrays(self.parameters)
        if self.base is not None:
            arrays["base"] = self.base.coefficients
        arrays["curve"] = np.array(self.curve, np.float64).reshape(-1, 3)
        record = ModelRecord(
            architecture=self.shape,
            recipe=self.options.loss,
            options=self.options.model_dump(exclude=_NOT_OF_A_TRAINING),
            steps=self.step,
            restarts=self.restarts,
            reproducible=self.options.steps is not None and self.device == "cpu",
            device=self.device,
            curve_columns=["step", "loss", "held-out force error"],
            held_out_error=self._force_error(self.held_out),
            direction_length=self._direction_length(),
        )
        return arrays, record.attributes()

    @torch.no_grad()
    def force_at(self, points):
        """Return the force (n, 3), float64, at points (n, 3): k = 1, unit frame."""
        phi, direction = self._answer(
            self._rows_of(points, np.zeros(len(points)), np.zeros((len(points), 3)))
        )
        force = -phi.clamp(max=0)[:, None] * torch.nn.functional.normalize(direction)
        return force.double().cpu().numpy()

    def _rows_of(self, *columns):
        rows = np.column_stack(columns).astype(np.float32)
        return torch.from_numpy(with_base(rows, self.base)).to(self.device)

    @torch.no_grad()
    def _offs(self, rows):
        """Return the magnitude (n,) of each row's force error, float64."""
        phi, direction = self._answer(rows)
        force = -phi.clamp(max=0)[:, None] * torch.nn.functional.normalize(direction)
        exact = -rows[:, 3:4].clamp(max=0) * rows[:, 4:7]
        return (force - exact).norm(dim=1).double()

    def _force_error(self, rows):
        error = self._offs(rows)
        return Error(mean=error.mean().item(), p99=error.quantile(0.99).item())

    @torch.no_grad()
    def _direction_length(self):
        size = self._answer(self.held_out)[1].norm(dim=1).double()
        return Spread(mean=size.mean().item(), std=size.std(correction=0).item())

    # --- states and checkpoints ----------------------------------------------------

    def _state(self):
        state = {
            "parameters": [p.detach() for p in self.parameters],
            "optimiser": self.optimiser.state(),
            "step": self.step,
            "curve": list(self.curve),
            "least": self.least,
            "slowdown": self.slowdown,
            "restarts": self.restarts,
        }
        return copy.deepcopy(state)

    def _restore(self, state):
        with torch.no_grad():
            for parameter, value in zip(self.parameters, state["parameters"], strict=True):
                parameter.copy_(value)
        self.optimiser.restore(copy.deepcopy(state["optimiser"]))
        self._recorded = RecordedStep(self._descend)  # the old one uses the old optimiser's memory
        self.step, self.curve = state["step"], list(state["curve"])
        self.least, self.slowdown = state["least"], state["slowdown"]
        self.restarts = state["restarts"]

    def _save(self):
        state = self.good | {"device": self.device, "elapsed": self.elapsed}
        part = self.checkpoint.with_suffix(".part")
        try:
            self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
            torch.save(state, part)
            part.replace(self.checkpoint)
        except (OSError, RuntimeError) as error:  # torch reports a full disk as RuntimeError
            # a checkpoint is optional, so the run continues without it
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            self.log(f"warning: no checkpoint at step {state['step']}: {error}")
        else:
            self.log(f"checkpoint at step {state['step']}")

    def _resume(self):
        if not self.checkpoint.is_file():
            return
        try:
            state = torch.load(self.checkpoint, weights_only=True, map_location=self.device)
        except Exception as error:
            self.log(f"the checkpoint {self.checkpoint} is damaged ({error}): starting afresh")
            self.checkpoint.unlink()
            return
        if state["device"] != self.device:
            self.log(
                f"the checkpoint was written on {state['device']}, and this run is on "
                f"{self.device}: starting afresh"
            )
            return
        self._restore(state)
        self.good, self.elapsed = self._state(), state["elapsed"]
        self.log(f"resumed at step {self.step} from {self.checkpoint}")

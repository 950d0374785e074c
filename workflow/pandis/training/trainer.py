"""Training: batches, schedule, checkpoints, held-out error."""

import contextlib
import math
import time
from pathlib import Path

import numpy as np
import torch

from pandis.errors import PandisError
from pandis.training.exact_loss import exact_loss
from pandis.training.network import Siren
from pandis.training.paper_loss import paper_loss

CHECKPOINT_SECONDS = 20.0
CURVE_POINTS = 100
QUICK = 4000


class Trainer:
    """Trains one network; the same options and samples give the same bytes.

    Whatever happens at a step depends on the seed and the step's number
    alone, so that a run resumed from a checkpoint ends as an undisturbed one.

    Parameters
    ----------
    options : dict
        See `pandis.config.PaperRecipe` and `ExactRecipe`; and ``seed``.
    samples : pandis.artifact.Artifact
        Of kind ``samples``.
    checkpoint : path-like
        Where to keep the state of an unfinished run.
    log : callable
        Takes a line of text.
    """

    def __init__(self, options, samples, checkpoint, log):
        torch.set_num_threads(options["threads"])
        torch.set_flush_denormal(True)
        torch.backends.cuda.matmul.allow_tf32 = False
        self.options, self.log = options, log
        self.checkpoint = Path(checkpoint)
        self.device = self._pick_device(options["device"])
        self.paper = options["loss"] == "paper"
        self._load(samples)
        generator = torch.Generator().manual_seed(options["seed"])
        network = Siren(options["width"], options["depth"], options["omega"], generator)
        self.network = network.to(self.device)
        self.parameters = list(self.network.parameters())
        decay = 0 if self.paper else options["average"]
        self.average = [p.detach().clone() for p in self.parameters] if decay else None
        self.optimiser = torch.optim.Adam(self.parameters, lr=options["learning_rate"], fused=True)
        self.step, self.elapsed, self.curve = 0, 0.0, []

    def _pick_device(self, wanted):
        if wanted == "cuda" and not torch.cuda.is_available():
            raise PandisError(
                "train: device is 'cuda', but torch finds no CUDA device; set it to 'auto' or 'cpu'"
            )
        return "cuda" if wanted != "cpu" and torch.cuda.is_available() else "cpu"

    def _load(self, samples):
        ranges = samples.attributes["strata"]
        data = np.column_stack([samples.arrays[k] for k in ("points", "distance", "normal")])
        held_out = slice(*ranges["held-out"])
        if self.paper:
            data_train = data[slice(*ranges["surface"])]
        else:
            data_train = np.concatenate([data[: held_out.start], data[held_out.stop :]])
        self.data = torch.from_numpy(np.ascontiguousarray(data_train)).to(self.device)
        self.held_out = torch.from_numpy(np.ascontiguousarray(data[held_out])).to(self.device)
        self._epoch = None

    # --- one step ----------------------------------------------------------------

    def _batch(self):
        """Return the rows of this step: a slice of the epoch's own permutation."""
        size = min(self.options["batch"], len(self.data))
        per_epoch = len(self.data) // size
        epoch, position = divmod(self.step, per_epoch)
        if epoch != self._epoch:
            rng = np.random.default_rng([self.options["seed"], 1, epoch])
            order = torch.from_numpy(rng.permutation(len(self.data)))
            self._epoch, self._order = epoch, order.to(self.device)
        return self.data[self._order[position * size : (position + 1) * size]]

    def _loss(self):
        rows = self._batch()
        points, distance, normal = rows[:, :3], rows[:, 3], rows[:, 4:]
        if not self.paper:
            return exact_loss(self.network(points), distance, normal, self.options)
        rng = np.random.default_rng([self.options["seed"], 2, self.step])
        box = rng.random((len(points), 3), dtype=np.float32) * 2 - 1
        both = torch.cat([points, torch.from_numpy(box).to(self.device)])
        output, gradient = self.network.forward_with_gradient(both)
        n = len(points)
        return paper_loss(output[:n], gradient[:n], output[n:], gradient[n:], normal, self.options)

    def _rate(self, share):
        """Return the step size at a share of the budget: warm-up, then half a cosine to zero."""
        top = self.options["learning_rate"]
        if self.paper:
            return top
        warmup = self.options["warmup"]
        if share < warmup:
            return top * (share / warmup + 1e-3)
        return top * 0.5 * (1 + math.cos(math.pi * (share - warmup) / (1 - warmup)))

    def _advance(self, share):
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate(share)
        self.optimiser.zero_grad(set_to_none=True)
        loss = self._loss()
        loss.backward()
        if self.options["clip"]:
            torch.nn.utils.clip_grad_norm_(self.parameters, self.options["clip"])
        self.optimiser.step()
        self.step += 1
        if self.average:
            # early on the average forgets faster, so that the start does not linger
            decay = min(self.options["average"], self.step / (self.step + 10))
            with torch.no_grad():
                torch._foreach_lerp_(self.average, self.parameters, 1 - decay)
        return loss

    # --- the run -----------------------------------------------------------------

    def run(self, progress):
        """Train to the end of the budget.

        Parameters
        ----------
        progress : callable
            Makes a `pandis.stage.Progress`.

        Returns
        -------
        arrays, attributes : dict
            As stored in ``model-….zarr.zip``.

        Raises
        ------
        PandisError
            The loss became NaN or infinite.
        """
        steps, seconds = self.options["steps"], self.options["seconds"]
        report = progress("training", steps or seconds, "steps" if steps else "seconds")
        self._resume()
        report.resume(self.step if steps else self.elapsed)
        start, saved = time.monotonic() - self.elapsed, time.monotonic()
        every = max(1, steps // CURVE_POINTS) if steps else 50
        note = ""
        while True:
            self.elapsed = time.monotonic() - start
            done = self.step if steps else self.elapsed
            if done >= (steps or seconds):
                break
            loss = self._advance(done / (steps or seconds))
            if self.step % every == 0:
                value = loss.item()
                self._check_finite()
                error = self.held_out_error(QUICK)["mean"]
                self.curve.append((self.step, value, error))
                note = f"loss {value:.4g}, held-out force error {error:.3e}"
            if time.monotonic() - saved > CHECKPOINT_SECONDS:
                self._check_finite()
                self._save()
                saved = time.monotonic()
            report.update(self.step if steps else time.monotonic() - start, note)
        result = self._result()
        self.log(f"{self.step} steps in {self.elapsed:.1f} s on {self.device}; {note}")
        return result

    def finish(self):
        """Remove the checkpoints, also those of older options: the artifact is written."""
        for path in self.checkpoint.parent.glob(f"{self.checkpoint.name.split('.')[0]}.*pt"):
            path.unlink()
        with contextlib.suppress(OSError):  # other recipes may still have theirs there
            self.checkpoint.parent.rmdir()

    def _check_finite(self):
        if not all(torch.isfinite(p).all() for p in self.parameters):
            self.checkpoint.unlink(missing_ok=True)
            raise PandisError(
                f"training diverged: weights are not finite at step {self.step}; reduce "
                f"train.{self.options.get('recipe')}.learning_rate "
                f"(now {self.options['learning_rate']:g}) or set clip"
            )

    def _result(self):
        self._check_finite()
        weights = self.average or [p.detach() for p in self.parameters]
        count = len(weights) // 2
        arrays = {}
        for index in range(count):
            arrays[f"weight_{index}"] = weights[index].cpu().numpy()
            arrays[f"bias_{index}"] = weights[count + index].cpu().numpy()
        arrays["curve"] = np.array(self.curve, np.float64).reshape(-1, 3)
        width, depth, omega = (self.options[k] for k in ("width", "depth", "omega"))
        return arrays, {
            "architecture": {"width": width, "depth": depth, "omega": omega, "outputs": 4},
            "recipe": self.options["loss"],
            "steps": self.step,
            "reproducible": self.options["steps"] is not None and self.device == "cpu",
            "device": self.device,
            "curve_columns": ["step", "loss", "held-out force error"],
            "held_out_error": self.held_out_error(None),
            "psi_length": self._psi_length(),
        }

    @torch.no_grad()
    def _answer(self, rows):
        """Ask the network whose weights would be kept."""
        if not self.average:
            return self.network(rows[:, :3])
        kept = [p.data for p in self.parameters]
        for parameter, mean in zip(self.parameters, self.average, strict=True):
            parameter.data = mean
        output = self.network(rows[:, :3])
        for parameter, weight in zip(self.parameters, kept, strict=True):
            parameter.data = weight
        return output

    def held_out_error(self, count):
        """Return the force error (k = 1, unit frame) on held-out points."""
        rows = self.held_out[:count]
        output = self._answer(rows)
        psi = torch.nn.functional.normalize(output[:, 1:])
        force = -output[:, :1].clamp(max=0) * psi
        exact = -rows[:, 3:4].clamp(max=0) * rows[:, 4:]
        error = (force - exact).norm(dim=1).double()
        return {"mean": error.mean().item(), "p99": error.quantile(0.99).item()}

    def _psi_length(self):
        size = self._answer(self.held_out)[:, 1:].norm(dim=1).double()
        return {"mean": size.mean().item(), "std": size.std(correction=0).item()}

    # --- checkpoints -------------------------------------------------------------

    def _save(self):
        state = {
            "parameters": [p.detach() for p in self.parameters],
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "device": self.device,
            "elapsed": self.elapsed,
            "curve": self.curve,
        }
        part = self.checkpoint.with_suffix(".part")
        try:
            self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
            torch.save(state, part)
            part.replace(self.checkpoint)
        except (OSError, RuntimeError) as error:  # torch reports a full disk as RuntimeError
            # a checkpoint is a convenience: the run goes on without
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            self.log(f"warning: no checkpoint at step {self.step}: {error}")
        else:
            self.log(f"checkpoint at step {self.step}")

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
            self.log(f"the checkpoint is of a run on {state['device']}: starting afresh")
            return
        with torch.no_grad():
            for parameter, value in zip(self.parameters, state["parameters"], strict=True):
                parameter.copy_(value)
        self.average = state["average"]
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.elapsed, self.curve = state["step"], state["elapsed"], state["curve"]
        self.log(f"resumed at step {self.step} from {self.checkpoint}")

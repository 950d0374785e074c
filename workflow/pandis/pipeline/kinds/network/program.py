"""Exports networks as PyTorch programs for LibTorch, as in the paper."""

import io
import json

import torch

from pandis.base.frame import Frame
from pandis.engine.spline import EDGE
from pandis.pipeline.kinds.network.graph import compare, describe
from pandis.pipeline.kinds.network.reference import load_base, load_layers
from pandis.pipeline.kinds.tricubic import AROUND, BASIS, SLOPE
from pandis.pipeline.run.job.artifact import seal_zip


class Spline(torch.nn.Module):
    """A tricubic B-spline over the box. Returns value (n,) and gradient (n, 3), float32.

    Parameters
    ----------
    lattice : pandis.engine.spline.Lattice
    coefficients : ndarray, shape (lattice.size,) * 3, float32
    """

    def __init__(self, lattice, coefficients):
        super().__init__()
        self.low, self.per_step = lattice.low, lattice.per_step
        strides = torch.tensor([lattice.size**2, lattice.size, 1])
        self.register_buffer("coefficients", torch.from_numpy(coefficients.reshape(-1)))
        self.register_buffer("strides", strides)
        self.register_buffer("around", torch.from_numpy(AROUND) @ strides)
        self.register_buffer("powers", torch.arange(4.0))
        self.register_buffer("basis", torch.from_numpy(BASIS).float())
        self.register_buffer("slope", torch.from_numpy(SLOPE * self.per_step).float())

    def forward(self, points):
        """Return value and gradient at float64 points (n, 3) in the box."""
        position = (points.clamp(-EDGE, EDGE) - self.low) * self.per_step
        cell = position.floor()
        powers = ((position - cell).float())[:, :, None] ** self.powers
        first = (cell.long() * self.strides).sum(1)
        cube = self.coefficients[first[:, None] + self.around].reshape(-1, 4, 4, 4)
        (wx, wy, wz), (dx, dy, dz) = (
            (powers @ matrix).unbind(1) for matrix in (self.basis, self.slope)
        )
        flat, rise = ((cube * w[:, None, None]).sum(3) for w in (wz, dz))
        line, turn, lift = (
            (part * w[:, None]).sum(2) for part, w in ((flat, wy), (flat, dy), (rise, wy))
        )
        gradient = [(part * w).sum(1) for part, w in ((line, dx), (turn, wx), (lift, wx))]
        return (line * wx).sum(1), torch.stack(gradient, 1)


class Program(torch.nn.Module):
    """A network with inputs and outputs in mesh units, like its ONNX graph.

    Takes float64 points (n, 3); returns distance (n,) and unit normal (n, 3), float32. It subtracts
    the centre and scales in float64, before the cast to float32.

    Parameters
    ----------
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``model``.
    """

    def __init__(self, artifact):
        super().__init__()
        frame = Frame.of(artifact)
        self.scale = float(frame.scale)
        self.register_buffer("centre", torch.tensor(frame.centre, dtype=torch.float64))
        self.register_buffer("up", torch.tensor([0.0, 0.0, 1.0]))
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        for weight, bias in load_layers(artifact):
            self.weights.append(torch.from_numpy(weight))
            self.biases.append(torch.from_numpy(bias))
        base = load_base(artifact)
        self.base = None if base is None else Spline(base.lattice, base.coefficients)
        self.requires_grad_(False)

    def forward(self, points):
        """Return distance and normal at points."""
        unit = (points - self.centre) * self.scale
        clamped = unit.clamp(-1.0, 1.0)
        outside = (unit - clamped).norm(dim=1).float()
        h, slopes = clamped.float(), []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            z = torch.nn.functional.linear(h, weight, bias)
            h = z.sin()
            slopes.append(z.cos())
        output = torch.nn.functional.linear(h, self.weights[-1], self.biases[-1])
        direction = output[:, 1:]
        if output.shape[1] == 1:
            direction = self.weights[-1]
            for weight, slope in zip(
                reversed(list(self.weights[:-1])), reversed(slopes), strict=True
            ):
                direction = (direction * slope) @ weight
        phi = output[:, 0]
        if self.base is not None:
            value, gradient = self.base(clamped)
            phi, direction = phi + value, direction + gradient
        length = direction.norm(dim=1, keepdim=True)
        nowhere = length == 0
        normal = torch.where(nowhere, self.up, direction / torch.where(nowhere, 1.0, length))
        return (phi + outside) / self.scale, normal


def export_program(name, artifact, provenance, *, log):
    """Return a network as the bytes of a ``.pt2`` file; equal networks give equal bytes.

    Parameters
    ----------
    name : str
        The recipe.
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``model``.
    provenance : dict
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The answers of the program, read back, differ from the network's.
    """
    torch.set_num_threads(1)
    count = torch.export.Dim("n", min=1)
    example = (torch.zeros(3, 3, dtype=torch.float64),)
    program = torch.export.export(Program(artifact), example, dynamic_shapes={"points": {0: count}})
    for node in program.graph.nodes:
        node.meta.pop("stack_trace", None)  # contains folder names of this machine
    data = io.BytesIO()
    metadata = json.dumps(describe(name, artifact, provenance), sort_keys=True)
    torch.export.save(program, data, extra_files={"metadata.json": metadata})
    data = seal_zip(data.getvalue())
    loaded = torch.export.load(io.BytesIO(data)).module()

    def answer(points):
        return [part.numpy() for part in loaded(torch.from_numpy(points))]

    compare(answer, artifact, "the program, read back,", log=log)
    return data

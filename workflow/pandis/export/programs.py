"""Export of networks as PyTorch programs, for LibTorch: the paper's own route."""

import io
import json

import torch

from pandis.artifact import seal_zip
from pandis.export.networks import compare, describe
from pandis.fields.siren import load_layers
from pandis.frame import Frame


class Program(torch.nn.Module):
    """A network from mesh units to mesh units, as its ONNX graph is.

    Takes points float64 (n, 3); answers distance (n,) and normal (n, 3) of unit length, float32.
    Centre and scale are taken off in float64, before the cast.

    Parameters
    ----------
    artifact : pandis.artifact.Artifact
        Of kind ``model``.
    """

    def __init__(self, artifact):
        super().__init__()
        frame = Frame.from_attributes(artifact.attributes["frame"])
        self.scale = float(frame.scale)
        self.register_buffer("centre", torch.tensor(frame.centre, dtype=torch.float64))
        self.register_buffer("up", torch.tensor([0.0, 0.0, 1.0]))
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        for weight, bias in load_layers(artifact):
            self.weights.append(torch.from_numpy(weight))
            self.biases.append(torch.from_numpy(bias))
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
        length = direction.norm(dim=1, keepdim=True)
        nowhere = length == 0
        normal = torch.where(nowhere, self.up, direction / torch.where(nowhere, 1.0, length))
        return (output[:, 0] + outside) / self.scale, normal


def export_program(name, artifact, provenance, log):
    """Return a network as the bytes of a ``.pt2`` file; equal networks give equal bytes.

    Parameters
    ----------
    name : str
        The recipe.
    artifact : pandis.artifact.Artifact
        Of kind ``model``.
    provenance : dict
    log : callable

    Raises
    ------
    PandisError
        The program, read back, does not answer as the network does.
    """
    torch.set_num_threads(1)
    count = torch.export.Dim("n", min=1)
    example = (torch.zeros(3, 3, dtype=torch.float64),)
    program = torch.export.export(Program(artifact), example, dynamic_shapes={"points": {0: count}})
    for node in program.graph.nodes:
        node.meta.pop("stack_trace", None)  # names folders of this machine
    data = io.BytesIO()
    metadata = json.dumps(describe(name, artifact, provenance), sort_keys=True)
    torch.export.save(program, data, extra_files={"metadata.json": metadata})
    data = seal_zip(data.getvalue())
    loaded = torch.export.load(io.BytesIO(data)).module()

    def answer(points):
        return [part.numpy() for part in loaded(torch.from_numpy(points))]

    compare(answer, artifact, "the program, read back,", log)
    return data

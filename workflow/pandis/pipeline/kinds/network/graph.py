"""Exports networks to ONNX. Each model is compared with PyTorch before it is written."""

import numpy as np
import torch
from onnx import TensorProto

from pandis.base.frame import Frame
from pandis.pipeline.kinds.check import check
from pandis.pipeline.kinds.field import clamp_to_box, normalise
from pandis.pipeline.kinds.graphs import Graph, enter, leave, split
from pandis.pipeline.kinds.network.record import Architecture
from pandis.pipeline.kinds.network.reference import load_base, load_layers
from pandis.pipeline.kinds.network.training.network import Siren
from pandis.pipeline.kinds.session import Session
from pandis.pipeline.kinds.tricubic import tricubic


def network_graph(artifact):
    """Return the graph of a sine network, with ω0 folded into its weights.

    Parameters
    ----------
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``model``.

    Returns
    -------
    Graph
    """
    frame = Frame.of(artifact)
    graph = Graph()
    clamped, outside = enter(graph, frame)
    h = graph.apply("Cast", clamped, to=TensorProto.FLOAT)
    layers = load_layers(artifact)
    own_gradient, slopes = len(layers[-1][0]) == 1, []
    for index, (weight, bias) in enumerate(layers):
        w = graph.constant(f"weight_{index}", weight)
        h = graph.apply("Gemm", h, w, graph.constant(f"bias_{index}", bias), transB=1)
        if index < len(layers) - 1:
            slopes.append(graph.apply("Cos", h) if own_gradient else None)
            h = graph.apply("Sin", h)
    if own_gradient:
        phi, direction = h, f"weight_{len(layers) - 1}"
        for index in reversed(range(len(layers) - 1)):
            direction = graph.apply("Mul", direction, slopes[index])
            direction = graph.apply("MatMul", direction, f"weight_{index}")
    else:
        phi, direction = split(graph, h, [1, 3])
    phi = graph.apply("Squeeze", phi, graph.constant("one", np.array([1], np.int64)))
    base = load_base(artifact)
    if base is not None:
        value, gradient = tricubic(graph, base.lattice, base.coefficients, clamped=clamped)
        phi = graph.apply("Add", phi, value)
        direction = graph.apply("Add", direction, gradient)
    leave(graph, frame, graph.apply("Add", phi, outside), vector=direction)
    return graph


def torch_network(artifact):
    """Return the torch network of a model artifact as it was trained, with ω0 not folded in."""
    network = Siren(**dict(Architecture.of(artifact)), generator=torch.Generator())
    with torch.no_grad():
        for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            weight.copy_(torch.from_numpy(artifact.arrays[f"weight_{index}"]))
            bias.copy_(torch.from_numpy(artifact.arrays[f"bias_{index}"]))
    return network


def compare(answer, artifact, what, *, log):
    """Compare an export with its network, and log by how much their answers differ.

    Parameters
    ----------
    answer : callable
        See `pandis.pipeline.kinds.check.check`.
    artifact : pandis.pipeline.run.job.artifact.Artifact
        Artifact of kind ``model``.
    what : str
        Name of the export, for the log.
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The answers differ by more than rounding.
    """
    base = load_base(artifact)
    single, double = torch_network(artifact), torch_network(artifact).double()

    def reference(points, network=single):
        clamped, outside = clamp_to_box(points)
        inputs = torch.from_numpy(clamped).to(next(network.parameters()).dtype)
        with torch.no_grad():
            output, direction = network.forward_with_gradient(inputs)
        output, direction = output.double().numpy(), direction.double().numpy()
        if output.shape[1] > 1:
            direction = output[:, 1:]
        phi = output[:, 0]
        if base is not None:
            value, gradient = base.evaluate(clamped)
            phi, direction = phi + value, direction + gradient
        length = (direction**2).sum(axis=1) ** 0.5
        return phi + outside, normalise(direction), length

    frame = Frame.of(artifact)
    differences = check(answer, reference, frame, double=lambda p: reference(p, double))
    log(f"{what} agrees with the network: {differences}")


def describe(name, artifact, provenance):
    """Return the metadata of an exported network."""
    keys = ("frame", "recipe", "architecture", "steps", "held_out_error")
    return {
        "field": name,
        "provenance": provenance,
        **{key: artifact.attributes[key] for key in keys},
    }


def export_network(name, artifact, provenance, *, log):
    """Return the ONNX model of a network as bytes.

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
        The answers of the model differ from PyTorch's.
    """
    torch.set_num_threads(1)
    model = network_graph(artifact).model(name, describe(name, artifact, provenance))
    compare(Session(model).distance_and_normal, artifact, "the ONNX model", log=log)
    return model

"""Sine networks on arrays: the arithmetic of parts/network.h, for many points at once."""

import numpy as np

from pandis.bridges.arrays.splines import dense_sum, lattice, off_edge


def network(contents):
    """Return a network's evaluation function and its data."""
    width, depth, outputs, cells, bits = contents.wholes[:5]
    stride = -(-width // 16) * 16
    sections = contents.sections

    def floats(name):
        return np.frombuffer(sections[name], "<f4")

    biases = floats("BIAS")
    data = {
        "depth": depth,
        "outputs": outputs,
        "cells": cells,
        "weights_0": floats("WIN ").reshape(3, stride)[:, :width].copy(),
        "last": floats("WOUT").reshape(outputs, stride)[:, :width].T.copy(),
        "last_bias": biases[depth * stride : depth * stride + outputs].copy(),
    }
    if bits == 32:
        hidden = floats("WHID").reshape(-1, stride)
    else:
        stored = np.frombuffer(sections["WHID"], "<i2").reshape(-1, stride)
        hidden = stored * floats("SCAL")[:, None]
    for layer in range(depth):
        rows = slice((layer - 1) * width, layer * width)
        if layer:
            data[f"weights_{layer}"] = hidden[rows, :width].astype(np.float32)
        data[f"bias_{layer}"] = biases[layer * stride : layer * stride + width].copy()
    if cells:
        data |= lattice("under", cells + 3, -1 - 2 / cells)
        data["under_values"] = floats("BASE").astype(np.float64)
    return _answer, data


def _answer(xp, data, box, *, away, grad):
    kind = data["weights_0"].dtype

    def outputs(points):
        h = _as(xp, points, kind)
        for layer in range(data["depth"]):
            h = xp.sin(h @ data[f"weights_{layer}"] + data[f"bias_{layer}"])
        return _as(xp, h @ data["last"] + data["last_bias"], points.dtype)

    if data["outputs"] == 4:
        out = outputs(box)
        value, direction = out[:, 0], out[:, 1:]
    else:
        value, direction = grad(lambda points: outputs(points)[:, 0], box)
    if data["cells"]:
        more, slope, _ = dense_sum(xp, data, "under", p=off_edge(xp, box))
        value, direction = value + more, direction + slope
    return value + away, direction


def _as(xp, values, kind):
    return values.to(kind) if xp.__name__ == "torch" else values.astype(kind)

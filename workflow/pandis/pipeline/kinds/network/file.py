"""The file of a network: 32-bit or 16-bit weights, in rows padded to whole lanes."""

import copy

import numpy as np

from pandis.base.forces import penalty_force
from pandis.pipeline.kinds.check import check_points
from pandis.pipeline.kinds.native import FieldFile
from pandis.runtime.field import NativeField
from pandis.runtime.field.constants import NETWORK
from pandis.runtime.field.files import Parts

#: Number of lanes in which a sum is computed; rows of weights are padded to a multiple of it.
_LANES = 16
#: Largest magnitude of a 16-bit weight, in quantisation steps.
_STEPS = 32767


class File(FieldFile):
    """See `FieldFile`."""

    def __init__(self, field, weight_bits):
        super().__init__(field, weight_bits)
        # the file must reproduce the answers of the rounded weights
        self.answering = _rounded(field) if weight_bits == 16 else field

    def parts(self):
        """See `FieldFile.parts`."""
        layers, base = self.field.layers, self.field.base
        (first, _), (last, last_bias) = layers[0], layers[-1]
        width, depth, outputs = len(first), len(layers) - 1, len(last)
        hidden = [weight.T for weight, _ in layers[1:-1]]
        rows = np.concatenate(hidden) if hidden else np.empty((0, width), np.float32)
        biases = np.zeros((depth, _padded(width)), np.float32)
        for index, (_, bias) in enumerate(layers[:-1]):
            biases[index, :width] = bias
        tail = np.zeros(4, np.float32)
        tail[:outputs] = last_bias
        sections = {
            "WIN ": _pad(first.T),
            "WOUT": _pad(last),
            "BIAS": np.append(biases.ravel(), tail),
        }
        if self.weight_bits == 16:
            steps, scales = _quantised(rows)
            sections |= {"WHID": _pad(steps), "SCAL": scales}
        else:
            sections["WHID"] = _pad(rows)
        cells = 0
        if base is not None:
            cells, sections["BASE"] = len(base.coefficients) - 3, base.coefficients
        return Parts(NETWORK, (width, depth, outputs, cells, self.weight_bits), (), sections)

    def notes(self, native):
        """See `FieldFile.notes`."""
        if self.weight_bits != 16:
            return []
        whole = NativeField(File(self.field, 32).data({}))
        change = _change(native, whole, self.field.frame)
        return [f"16-bit weights change the answers: {change}"]

    def direction_length(self, field, points):
        """See `FieldFile.direction_length`."""
        return np.linalg.norm(field.direction(np.clip(points, -1, 1))[1], axis=1)

    def double(self):
        """See `FieldFile.double`."""
        return self.answering.in_double()


def network_bytes(width, depth, outputs, *, base, weight_bits):
    """Return the number of bytes that ``pandis.h`` needs to query a network.

    Parameters
    ----------
    width, depth, outputs : int
        Units per sine layer, number of sine layers, and outputs.
    base : int or None
        Cells per axis of the spline that the network corrects.
    weight_bits : {32, 16}
    """
    row, rows = _padded(width), (depth - 1) * width
    scales = 4 * rows if weight_bits == 16 else 0
    ends = 4 * (3 * row + outputs * row + depth * row + 4)
    return ends + rows * row * weight_bits // 8 + scales + (4 * (base + 3) ** 3 if base else 0)


def _padded(width):
    return -(-width // _LANES) * _LANES


def _pad(rows):
    return np.pad(rows, ((0, 0), (0, _padded(rows.shape[1]) - rows.shape[1])))


def _rounded(field):
    """Return a field with its hidden weights rounded as its 16-bit file stores them."""
    rounded, inner = copy.copy(field), []
    for weight, bias in field.layers[1:-1]:
        steps, scales = _quantised(weight.T)
        inner.append(((steps * scales[:, None]).T.astype(np.float32), bias))
    rounded.layers = [field.layers[0], *inner, field.layers[-1]]
    return rounded


def _quantised(rows):
    """Return rows as integers, and the step size of each row."""
    scales = (np.abs(rows).max(axis=1, initial=0) / _STEPS).astype(np.float32)
    steps = np.rint(rows / np.maximum(scales, np.float32(1e-30))[:, None])
    return steps.astype(np.int16), scales


def _change(one, other, frame):
    """Return the differences between the answers of two native fields, unit frame."""
    points = check_points(frame)
    inside = (np.abs(frame.to_unit(points)) <= 1).all(axis=1)
    (d1, n1), (d2, n2) = (field.distance_and_normal(points[inside]) for field in (one, other))
    force = penalty_force(d1 * frame.scale, n1) - penalty_force(d2 * frame.scale, n2)
    size = np.linalg.norm(force, axis=1)
    return {
        "distance": float(np.abs(d1 - d2).max() * frame.scale),
        "force, mean": float(size.mean()),
        "force, 99 %": float(np.percentile(size, 99)),
    }

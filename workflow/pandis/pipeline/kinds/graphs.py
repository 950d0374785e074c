"""The parts that all ONNX graphs of fields share; graphs are written node by node.

Every graph takes ``points`` float64 (n, 3) in mesh units and returns
``distance`` float32 (n,) in mesh units and ``normal`` float32 (n, 3) of unit
length. The graph subtracts the centre and scales in float64, before the cast,
so that a mesh far from its origin loses no digits.
"""

import hashlib
import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

OPSET = 17
IR_VERSION = 9
_SEAL = "sha256"


class Graph:
    """Collects the nodes and constants of one ONNX graph."""

    def __init__(self):
        self.nodes, self.constants = [], []

    def constant(self, name, value):
        """Add a constant array; return its name."""
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def apply(self, op, *inputs, name=None, **attributes):
        """Add a node with one output; return the output's name."""
        name = name or f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, list(inputs), [name], **attributes))
        return name

    def scalar(self, value, dtype=np.float32):
        """Add a constant scalar; return its name."""
        return self.constant(f"c{len(self.constants)}", np.array(value, dtype))

    def model(self, name, metadata):
        """Return the finished model as bytes; equal graphs give equal bytes."""
        points = helper.make_tensor_value_info("points", TensorProto.DOUBLE, ["n", 3])
        distance = helper.make_tensor_value_info("distance", TensorProto.FLOAT, ["n"])
        normal = helper.make_tensor_value_info("normal", TensorProto.FLOAT, ["n", 3])
        graph = helper.make_graph(self.nodes, name, [points], [distance, normal], self.constants)
        model = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="pandis",
        )
        texts = {
            key: value if isinstance(value, str) else json.dumps(value, sort_keys=True)
            for key, value in sorted(metadata.items())
        }
        helper.set_model_props(model, texts)
        onnx.checker.check_model(model)
        model.metadata_props.add(key=_SEAL, value=unsealed_digest(model))
        return model.SerializeToString(deterministic=True)


def unsealed_digest(model):
    """Return the SHA-256 of a model without the metadata entry that stores this digest."""
    bare = onnx.ModelProto()
    bare.CopyFrom(model)
    unsealed = [entry for entry in bare.metadata_props if entry.key != _SEAL]
    del bare.metadata_props[:]
    bare.metadata_props.extend(unsealed)
    return hashlib.sha256(bare.SerializeToString(deterministic=True)).hexdigest()


def enter(graph, frame, low=(-1.0,) * 3, *, high=(1.0,) * 3):
    """Map points to the unit frame and clamp them; return them and the distances moved."""
    centre = graph.constant("centre", np.array(frame.centre, np.float64))
    scale = graph.scalar(frame.scale, np.float64)
    unit = graph.apply("Mul", graph.apply("Sub", "points", centre), scale)
    least, most = (graph.constant(n, np.array(c)) for n, c in (("low", low), ("high", high)))
    clamped = graph.apply("Min", graph.apply("Max", unit, least), most)
    away = graph.apply("Sub", unit, clamped)
    outside = graph.apply("ReduceL2", away, axes=[1], keepdims=0)
    return clamped, graph.apply("Cast", outside, to=TensorProto.FLOAT)


def leave(graph, frame, distance, *, vector):
    """Add the outputs: distance in mesh units, vector at unit length (+z if it is zero)."""
    inverse = graph.scalar(1.0 / frame.scale)
    graph.apply("Mul", distance, inverse, name="distance")
    length = graph.apply("ReduceL2", vector, axes=[1], keepdims=1)
    zero = graph.apply("Equal", length, graph.scalar(0.0))
    up = graph.constant("up", np.array([[0, 0, 1]], np.float32))
    safe = graph.apply("Where", zero, graph.scalar(1.0), length)
    graph.apply("Where", zero, up, graph.apply("Div", vector, safe), name="normal")


def split(graph, value, sizes, *, prefix="part"):
    """Split (n, k) or (n, k, m) along its second axis; return the names of the parts."""
    names = [f"{prefix}{index}" for index in range(len(sizes))]
    split = graph.constant(f"{prefix}_sizes", np.array(sizes, np.int64))
    graph.nodes.append(helper.make_node("Split", [value, split], names, axis=1))
    return names

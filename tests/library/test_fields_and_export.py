import dataclasses
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from pandis.base.errors import ArtifactError, PandisError
from pandis.base.forces import penalty_force
from pandis.base.frame import Frame
from pandis.pipeline.geometry.distance import ShapeDistance
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.check import DISTANCE, FORCE, check, check_points
from pandis.pipeline.kinds.field import Field, clamp_to_box, normalise
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.graph import export_grid
from pandis.pipeline.kinds.grid.interpolation import GridField
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.graph import export_network, torch_network
from pandis.pipeline.kinds.network.program import export_program
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.training.network import Siren
from pandis.pipeline.kinds.opening import open_field, open_fields
from pandis.pipeline.kinds.session import Session, read_export, read_program_metadata
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.job.artifact import read_artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field import NativeField
from support import ROOT, artifact

FRAME = Frame((100.0, -2.0, 0.5), 0.9)
ENGINE = ShapeDistance(SHAPES["sphere"], Frame((0.0, 0.0, 0.0), 0.9))


def grid(content, size):
    made = DenseGrid(ENGINE, content, size, band=(0.045, 0.02), progress=silent_progress)
    values = np.concatenate(list(made.slabs(5)))
    return artifact("grid", {"values": values}, made.attributes() | FRAME.attributes())


def model(width=16, depth=2, omega=15.0, outputs=4, seed=0, base=False):
    network = Siren(
        width, depth, omega, outputs=outputs, generator=torch.Generator().manual_seed(seed)
    )
    arrays = {"curve": np.zeros((0, 3))}
    for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays[f"weight_{index}"] = weight.detach().numpy()
        arrays[f"bias_{index}"] = bias.detach().numpy()
    if base:
        arrays["base"] = fit_base(ENGINE, 8).coefficients
    shape = {"width": width, "depth": depth, "omega": omega, "outputs": outputs}
    attributes = {**FRAME.attributes(), "architecture": shape, "recipe": "exact"}
    attributes |= {"steps": 0, "held_out_error": {"mean": 0.1}}
    return artifact("model", arrays, attributes), network


# --- any field --------------------------------------------------------------------------


def test_mesh_units_in_and_out():
    held = grid("normal", 24)
    field = GridField("g", held)
    unit = np.array([[0.0, 0.0, 0.7]])
    distance, normal = field.distance_and_normal(FRAME.to_mesh(unit))
    assert distance[0] * FRAME.scale == pytest.approx(field.answer(unit)[0][0])
    assert normal[0] == pytest.approx([0, 0, 1], abs=1e-6)


def test_far_away_there_is_no_ghost_contact():
    held, _ = model()
    fields = [GridField("g", grid("normal", 8)), SirenField("s", held)]
    far = np.array([[1e6, 0, 0], [0, -3e3, 2.0]])
    for field in fields:
        distance, normal = field.answer(far)
        assert (distance > 0.99 * np.linalg.norm(far, axis=1) - 2).all()
        assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
    force = penalty_force(*GridField("f", grid("force", 8)).answer(far))
    assert (force == 0).all()


def test_base_refuses_to_answer():
    with pytest.raises(TypeError, match="must implement"):
        Field("x", FRAME, 0).answer(np.zeros((1, 3)))


def test_clamp_and_normalise():
    clamped, outside = clamp_to_box(np.array([[2.0, 0, 0], [4, 5, 0.5], [0.1, 0.2, 0.3]]))
    assert outside.tolist() == [1.0, 5.0, 0.0]
    assert clamped.tolist() == [[1, 0, 0], [1, 1, 0.5], [0.1, 0.2, 0.3]]
    assert normalise(np.array([[0.0, 0, 0], [3, 0, 4]])).tolist() == [[0, 0, 1], [0.6, 0, 0.8]]


# --- networks -------------------------------------------------------------------------


def test_numpy_network_is_the_torch_network():
    held, network = model(64, 4, 30.0)
    points = np.random.default_rng(0).uniform(-1, 1, (1000, 3))
    with torch.no_grad():
        # the same float32 weights and points, computed in float64
        wanted = network.double()(torch.from_numpy(points).float().double()).numpy()
    phi, psi = SirenField("s", held).direction(points)
    assert np.abs(phi - wanted[:, 0]).max() < 2e-6
    assert np.abs(psi - wanted[:, 1:]).max() < 2e-6
    assert SirenField("s", held).bytes == sum(p.numel() * 4 for p in network.parameters())


def test_numpy_gradient_is_that_of_torch():
    held, network = model(64, 4, 60.0, outputs=1)
    points = np.random.default_rng(0).uniform(-1, 1, (1000, 3))
    wanted = network.double().forward_with_gradient(torch.from_numpy(points).float().double())
    phi, direction = SirenField("s", held).direction(points)
    assert np.abs(phi - wanted[0].detach().numpy()[:, 0]).max() < 2e-6
    assert np.abs(direction - wanted[1].detach().numpy()).max() < 2e-5


def test_paper_network_has_the_papers_800_kb():
    held, _ = model(256, 4, 30.0)
    assert SirenField("s", held).bytes == 797_712


def test_torch_network_is_rebuilt_bit_by_bit():
    held, network = model()
    again = torch_network(held)
    for a, b in zip(network.parameters(), again.parameters(), strict=True):
        assert torch.equal(a, b)


# --- export ---------------------------------------------------------------------------


def exported(kind):
    if kind.startswith("network"):
        held, _ = model(32, 3, outputs=1 if "one" in kind else 4, base="base" in kind)
        return export_network("s", held, {"stage": "x"}, log=print), SirenField("s", held)
    held = grid(CONTENTS[kind.removesuffix("-12")], 12)
    field = open_field(parse_field(kind, ()), held)
    return export_grid(kind, held, {"stage": "x"}, log=print), field


KINDS = [
    "nearest-12",
    "trilinear-12",
    "trilinear-normal-12",
    "trilinear-gradient-12",
    "tricubic-12",
    "network",
    "network-on-a-base",
    "network-of-one-output",
    "network-of-one-output-on-a-base",
]


@pytest.mark.parametrize("kind", KINDS)
def test_export_answers_as_the_field_does(kind):
    data, field = exported(kind)
    points = np.concatenate([check_points(FRAME, seed=7), FRAME.to_mesh(np.eye(3))])
    distance, normal = Session(data).distance_and_normal(points)
    wanted_distance, wanted_normal = field.distance_and_normal(points)
    assert distance.dtype == normal.dtype == np.float32
    assert np.abs(distance - wanted_distance).max() * FRAME.scale < DISTANCE
    force = penalty_force(distance * FRAME.scale, normal)
    wanted = penalty_force(wanted_distance * FRAME.scale, wanted_normal)
    assert np.linalg.norm(force - wanted, axis=1).max() < FORCE
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_export_has_the_contracts_interface_and_provenance(kind, tmp_path):
    data, _ = exported(kind)
    graph = onnx.load_from_string(data).graph
    assert [v.name for v in graph.input] == ["points"]
    assert graph.input[0].type.tensor_type.elem_type == onnx.TensorProto.DOUBLE
    assert [v.name for v in graph.output] == ["distance", "normal"]
    metadata = Session(data).metadata
    assert json.loads(metadata["frame"])["scale"] == FRAME.scale
    path = tmp_path / "a.onnx"
    path.write_bytes(data)
    assert json.loads(read_export(path).metadata["provenance"]) == {"stage": "x"}
    assert exported(kind)[0] == data  # same content, same bytes


def test_damaged_export_is_noticed(tmp_path):
    data, _ = exported("network")
    path = tmp_path / "a.onnx"
    for index in np.random.default_rng(0).integers(0, len(data), 150):
        broken = bytearray(data)
        broken[index] ^= 1 << int(index % 8)
        path.write_bytes(broken)
        with pytest.raises(ArtifactError):
            Session(path)
    path.write_bytes(data[:-5])
    with pytest.raises(ArtifactError, match="not readable as ONNX"):
        Session(path)


@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("outputs", [1, 4])
def test_program_answers_as_the_field_does(tmp_path, outputs, base):
    held, _ = model(32, 3, outputs=outputs, base=base)
    data = export_program("s", held, {"stage": "x"}, log=print)
    assert export_program("s", held, {"stage": "x"}, log=print) == data
    assert str(ROOT).encode() not in data  # no folders of this machine
    path = tmp_path / "a.pt2"
    path.write_bytes(data)
    assert read_program_metadata(path)["provenance"] == {"stage": "x"}
    program = torch.export.load(path).module()
    field = SirenField("s", held)
    points = np.concatenate([check_points(FRAME, seed=7), FRAME.to_mesh(np.eye(3))])
    for some in (points, points[:1], points[:2]):
        distance, normal = (part.numpy() for part in program(torch.from_numpy(some)))
        wanted_distance, wanted_normal = field.distance_and_normal(some)
        assert distance.dtype == normal.dtype == np.float32
        assert np.abs(distance - wanted_distance).max() * FRAME.scale < DISTANCE
        force = penalty_force(distance * FRAME.scale, normal)
        wanted = penalty_force(wanted_distance * FRAME.scale, wanted_normal)
        assert np.linalg.norm(force - wanted, axis=1).max() < FORCE


def test_damaged_program_is_noticed(tmp_path):
    held, _ = model(16, 2, outputs=1)
    data = export_program("s", held, {}, log=print)
    path = tmp_path / "a.pt2"
    for index in np.random.default_rng(0).integers(0, len(data), 150):
        broken = bytearray(data)
        broken[index] ^= 1 << int(index % 8)
        path.write_bytes(broken)
        with pytest.raises(ArtifactError):
            read_program_metadata(path)
    path.write_bytes(data[:-5])
    with pytest.raises(ArtifactError):
        read_program_metadata(path)


@pytest.mark.parametrize(("what", "length"), [("distance", 0.01), ("force", 0.2), ("normal", 1)])
def test_check_refuses_a_wrong_export(what, length):
    """A direction counts for the force from a tenth of unit length on, as a normal from half."""
    data, field = exported("trilinear-normal-12")
    turned = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])

    def reference(points):
        distance, normal = field.answer(points)
        if what == "distance":
            distance = distance + 2 * DISTANCE
        elif what == "force":
            normal = normal @ turned
        else:  # so little that no force shows it
            normal = normal + 3e-5 * (normal @ turned)
            distance = np.maximum(distance, 0.0)
        return distance, normal, np.full(len(points), length)

    def answer(points):
        distance, normal = Session(data).distance_and_normal(points)
        return (np.maximum(distance, 0) if what == "normal" else distance), normal

    with pytest.raises(PandisError, match=f"differs from its field: {what} by"):
        check(answer, reference, FRAME)


def test_check_forgives_a_direction_that_is_rounding_noise():
    data, field = exported("trilinear-normal-12")

    def reference(points):
        distance, normal = field.answer(points)
        return distance, -normal, np.full(len(points), 0.01)

    check(Session(data).distance_and_normal, reference, FRAME)


def test_what_single_precision_loses_in_a_sharp_network_is_no_defect_and_a_wrong_weight_is():
    """A network with creases turns normals by more than the bound, by its own rounding alone."""
    held, _ = model(32, 3)
    held.arrays["weight_0"] *= 60
    field = SirenField("s", held)
    double = field.in_double()

    def told(network):
        def reference(points):
            distance, normal = network.answer(points)
            return distance, normal, np.full(len(points), 1.0)

        return reference

    file = NativeField(native_bytes(field, {}))
    with pytest.raises(PandisError, match="normal by"):
        check(file.distance_and_normal, told(field), FRAME)
    check(file.distance_and_normal, told(field), FRAME, double=told(double))
    held.arrays["weight_1"][3, 4] += 1e-3
    wrong = NativeField(native_bytes(SirenField("s", held), {}))
    with pytest.raises(PandisError, match="differs from its field"):
        check(wrong.distance_and_normal, told(field), FRAME, double=told(double))


def test_far_from_the_origin_no_digits_are_lost():
    """Centre and scale are taken off in float64: float32 points would be off by 0.06 at 1e6."""
    held, _ = model(32, 3)
    far = Frame((1e6, -1e6, 1e6), 0.9)
    held.attributes.update(far.attributes())
    session = Session(export_network("s", held, {}, log=print))
    unit = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    distance, _ = session.distance_and_normal(far.to_mesh(unit))
    near, _ = SirenField("s", held).answer(unit)
    assert np.abs(distance * far.scale - near).max() < 1e-5


def test_session_names_a_damaged_file(tmp_path):
    path = tmp_path / "bad.onnx"
    path.write_bytes(b"not a model")
    with pytest.raises(ArtifactError, match=r"bad\.onnx.*rebuild it with: snakemake"):
        Session(path)
    with pytest.raises(PandisError, match="cannot load the model"):
        Session(b"not a model")


def named(held):
    return dataclasses.replace(held, path=Path("grid-force-24.zarr.zip"))


def test_what_has_a_file_is_answered_by_it(tmp_path):
    """Evaluation and stress see the file: one that holds another field shows as that field."""
    arrays = dict(zip(("vertices", "faces"), SHAPES["sphere"].tessellation(), strict=True))
    mesh = artifact("mesh", arrays, {**FRAME.attributes(), "shape": "sphere"})
    held = {n: grid("force", n) for n in (8, 24)}
    coarse, fine = (open_field(parse_field(f"trilinear-{n}", ()), held[n]) for n in held)
    path = tmp_path / "trilinear-24.pandis"
    path.write_bytes(native_bytes(coarse, {}))
    (field,) = open_fields(["trilinear-24"], mesh, [named(held[24]), path])
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (500, 3))
    assert np.allclose(field.answer(points)[0], coarse.answer(points)[0], rtol=0, atol=1e-12)
    assert np.abs(field.answer(points)[0] - fine.answer(points)[0]).max() > 1e-3
    (own,) = open_fields(["trilinear-24"], mesh, [named(held[24])])  # it has no file
    assert np.array_equal(own.answer(points)[0], fine.answer(points)[0])


# --- a finished run -------------------------------------------------------------------


@pytest.mark.slow
def test_fields_of_a_run_open_by_name(finished):
    home = finished / "results" / "sphere"
    stems = ("grid-force-24", "model-pandis-exact")
    held = [read_artifact(home / f"{stem}.zarr.zip") for stem in stems]
    names = ["trilinear-24", "pandis-exact"]
    fields = open_fields(names, read_artifact(home / "mesh.zarr.zip"), held)
    assert [field.name for field in fields] == names
    assert fields.exact.name == "exact"
    points = np.array([[0.0, 0.0, 0.98], [0.57, 0.57, 0.57]])
    for field in [*fields, fields.exact]:
        distance, normal = field.distance_and_normal(points)
        exact = np.linalg.norm(points, axis=1) - 1
        assert np.abs(distance - exact).max() < 0.03
        assert np.abs(normal - points / np.linalg.norm(points, axis=1, keepdims=True)).max() < 0.1

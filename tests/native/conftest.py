"""Files for pandis.h of every kind, small, and of the torus."""

import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.compact.packing import build_compact
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.grid.dense import DenseGrid
from pandis.pipeline.kinds.grid.spec import CONTENTS
from pandis.pipeline.kinds.native import export_native, native_bytes
from pandis.pipeline.kinds.network.base import fit_base
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.kinds.spline.lattices import SplineFit, samples_for
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.job.stage import silent_progress
from pandis.runtime.field.constants import RULES
from support import ROOT, artifact, once

ENGINE = ROOT / "workflow/pandis/engine"
#: A frame that is not the unit frame, so that forgetting it shows.
FRAME = Frame((3.0, -2.0, 0.5), 0.6428571428571429)


def closed_form(name):
    """Return the mesh artifact of a closed form."""
    shape = SHAPES[name]
    frame = Frame.of_bounds(-shape.half_extent, shape.half_extent)
    arrays = dict(zip(("vertices", "faces"), shape.tessellation(), strict=True))
    return artifact("mesh", arrays, {"shape": name, **frame.attributes()})


def network(engine, width, depth, outputs, base):
    """Return an untrained network; the weights are as a trained one's in size."""
    rng = np.random.default_rng(width)
    sizes, arrays = [3, *[width] * depth, outputs], {}
    for index, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        bound = 1 / 3 if index == 0 else np.sqrt(6 / fan_in) / 30
        arrays[f"weight_{index}"] = rng.uniform(-bound, bound, (fan_out, fan_in)).astype(np.float32)
        arrays[f"bias_{index}"] = rng.uniform(-0.3, 0.3, fan_out).astype(np.float32)
    if base:
        arrays["base"] = fit_base(engine, base).coefficients
    shape = {"width": width, "depth": depth, "omega": 30.0, "outputs": outputs}
    attributes = {"architecture": shape, **FRAME.attributes()}
    return SirenField("network", artifact("model", arrays, attributes))


class Meshes(dict):
    """The mesh artifact that each field is of: closed forms, and the torus of faces."""

    def __missing__(self, name):
        return self["exact"]


@pytest.fixture(scope="session")
def meshes():
    """Return the mesh artifact of every field, by the field's name."""
    vertices, faces = SHAPES["torus"].tessellation(60, 30)
    frame = Frame.of_bounds(vertices.min(axis=0), vertices.max(axis=0))
    own = artifact("mesh", {"vertices": FRAME.to_mesh(frame.to_unit(vertices)), "faces": faces},
                   {**FRAME.attributes(), "shape": None})  # fmt: skip
    return Meshes({name: closed_form(name) for name in SHAPES} | {"exact": own})


@pytest.fixture(scope="session")
def fields(meshes):
    """Return a field by name: everything that has a native file."""
    found = {"exact": ExactField("exact", Body.open(meshes["exact"]))}
    engine = found["exact"].engine
    arrays, record = build_compact(Body.open(meshes["exact"]), 14, 0, log=lambda text: None)
    held = artifact("compact", arrays, record.attributes() | FRAME.attributes())
    found["compact"] = CompactField("compact-14", held)
    for rule in (*RULES, "nearest-box", "trilinear-box"):
        made = DenseGrid(engine, CONTENTS[rule], 20, band=(0.2, 0.1), progress=silent_progress)
        values = np.concatenate(list(made.slabs(32)))
        held = artifact("grid", {"values": values}, made.attributes() | FRAME.attributes())
        found[rule] = open_field(parse_field(f"{rule}-20", ()), held)
    fitted = SplineFit(found["exact"].body, (0.2, 0.1), 0, count=samples_for(budget=60_000))
    arrays, attributes = fitted.build(fitted.choose_size(60_000), 60_000, silent_progress)
    held = artifact("grid", arrays, attributes | FRAME.attributes())
    found["spline"] = open_field(parse_field("spline-auto", ()), held)
    found["network"] = network(engine, 64, 4, 4, 0)
    found["gradient"] = network(engine, 50, 4, 1, 8)
    found["shallow"] = network(engine, 17, 1, 1, 0)
    for shape in SHAPES:
        found[shape] = ExactField("exact", Body.open(meshes[shape]))
    return found


@pytest.fixture(scope="session")
def files(fields, meshes, tmp_path_factory):
    """Return the path of every field's file."""
    folder = tmp_path_factory.mktemp("native")
    paths = {}
    for name, field in fields.items():
        paths[name] = folder / f"{name}.pandis"
        engine = Body.open(meshes[name]).distance
        safe = clearance(lambda points, f=field: f.query(points)[::2], engine)
        paths[name].write_bytes(native_bytes(field, {"of": name}, safe=safe))
    for name in ("network", "gradient"):  # for what is asked of bytes, not of answers
        paths[f"{name}-16"] = folder / f"{name}-16.pandis"
        paths[f"{name}-16"].write_bytes(native_bytes(fields[name], {"of": name}, 16))
    body, options = Body.open(meshes["compact"]), NativeOptions(original_faces=True)
    paths["compact-faces"] = folder / "compact-faces.pandis"
    paths["compact-faces"].write_bytes(
        export_native(
            fields["compact"], body, options, provenance={"of": "compact"}, log=lambda text: None
        )
    )
    return paths


@pytest.fixture(scope="session")
def sanitized(tmp_path_factory):
    """Return the program ``sanitized.c``."""
    if not shutil.which("gcc"):
        pytest.skip("no gcc here")
    flags = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-g"]
    flags += ["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O1", "-Wall", "-Werror"]
    source = Path(__file__).with_name("sanitized.c")

    def build(folder):
        folder.mkdir()
        subprocess.run(
            ["gcc", *flags, "-I", ENGINE, source, "-lm", "-o", folder / "main"], check=True
        )

    return once(tmp_path_factory, "sanitized", build) / "main"


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """Return a stand-in, and one that does not say that it is one."""
    if not shutil.which("gcc"):
        pytest.skip("no gcc here")
    from test_devices import compile_stand_in

    folder = tmp_path_factory.mktemp("hd")
    marked = compile_stand_in(folder / "libHD.so")
    return marked, compile_stand_in(folder / "libHDreal.so", "-DUNMARKED")

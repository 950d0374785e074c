"""pandis.h: the library's answers, the same bits from every compiler, and safe on any file."""

import itertools
import json
import os
import platform
import re
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch

import pandis
from pandis.base.errors import ArtifactError
from pandis.base.forces import penalty_force
from pandis.base.frame import UNIT
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.kinds.field import BOUND, INVALID
from pandis.pipeline.kinds.native import export_native, native_bytes
from pandis.pipeline.kinds.network.file import network_bytes
from pandis.pipeline.kinds.network.reference import SirenField
from pandis.pipeline.kinds.network.training.network import Siren, named_arrays
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.job.artifact import Artifact
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import Parts, pack, read_provenance
from pandis.runtime.servo import run_ticks
from support import ROOT

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
ENGINE = Path(pandis.__file__).parent / "engine"
NAMES = ("exact", "nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
NAMES += ("nearest-box", "trilinear-box", "spline", "network", "gradient", "shallow")
NAMES += ("sphere", "torus", "box", "capsule", "compact")
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wvla", "-Werror", "-I", str(ENGINE))
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")
needs_cpp = pytest.mark.skipif(not shutil.which("g++"), reason="no g++ here: apt-get install g++")
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


def points_for(field, count=3000):
    """Return points (n, 3) in mesh units: in the box, around it, on its edges."""
    rng = np.random.default_rng(4)
    unit = rng.uniform(-1, 1, (count, 3))
    unit[::5] *= 2.5
    corners = list(itertools.product([-1.0, 0.0, 1.0], repeat=3))
    return field.frame.to_mesh(np.concatenate([unit, corners]))


def closeness(name, field):
    """Return how close distances must be to the library's (unit frame)."""
    return field.record.rounding if name == "compact" else 1e-14


@pytest.mark.parametrize("name", NAMES)
def test_it_answers_as_the_library_does(name, fields, files):
    """To the last bit but one, where no float32 sums or comparisons are in another order."""
    field = fields[name]
    points = points_for(field)
    native, wanted = NativeField(files[name]), field.query(field.frame.to_unit(points))
    found = native.query(points)
    network = isinstance(field, SirenField)
    scale = field.frame.scale
    close = 2e-6 if network else closeness(name, field)
    assert found.distance * scale == pytest.approx(wanted.distance, abs=close)
    assert np.array_equal(found.flag, wanted.flag)
    assert np.linalg.norm(found.normal, axis=1) == pytest.approx(1, abs=1e-14)
    force = penalty_force(found.distance * scale, found.normal)
    off = np.linalg.norm(force - penalty_force(wanted.distance, wanted.normal), axis=1)
    sure = field.direction(field.frame.to_unit(points))[1] if network else None
    sure = np.linalg.norm(sure, axis=1) > 0.1 if network else np.ones(len(points), bool)
    if name == "compact":  # of faces that are equally near but for rounding any may answer,
        unit = field.frame.to_unit(points)  # with a point of the surface
        foot = field.answer(unit - (found.distance * scale)[:, None] * found.normal)[0]
        assert np.abs(foot).max() < 1e-9
        sure = off < 1e-13
        assert sure.mean() > 0.99
    assert off[sure].max() < (1e-5 if network else 1e-13)
    assert native.force(points, k=3.0) == pytest.approx(3 * force / scale, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("name", [*NAMES, "network-16", "gradient-16"])
def test_many_points_get_the_bits_that_each_gets_alone(name, files):
    """A network reads its weights once for eight points: nothing else may come of that."""
    check_many_points(NativeField(files[name]))


@pytest.mark.parametrize(("width", "outputs"), [(40, 4), (500, 1), (1000, 1)])
def test_points_of_wide_networks_share_passes_as_far_as_memory_goes(width, outputs):
    """Eight, four, and one at a time."""
    seed = torch.Generator().manual_seed(0)
    network = Siren(width, 4, 30.0, outputs=outputs, generator=seed)
    shape = {"width": width, "depth": 4, "omega": 30.0, "outputs": outputs}
    arrays = named_arrays(list(network.parameters()))
    model = Artifact("model", arrays, UNIT.attributes() | {"architecture": shape})
    for bits in (32, 16):
        check_many_points(NativeField(native_bytes(SirenField("network", model), {}, bits)))


def check_many_points(native):
    """Check that queries of many points give each point the bits that it gets alone."""
    points = points_for(native, count=60)
    points[[5, 10, 11]] = np.nan
    points[7, 1] = 1e200
    alone = [native.query(point) for point in points]
    for count in (0, 1, 3, 4, 5, 8, 9, 12, 15, len(points)):
        together, lengths = native.query_slopes(points[:count])
        for found in (native.query(points[:count]), together):
            for column, answers in zip(found, zip(*alone, strict=True), strict=True):
                wanted = np.concatenate([*answers[:count], np.empty_like(answers[0][:0])])
                assert column.tobytes() == wanted.tobytes()
        assert np.isnan(lengths).sum() == (together.flag == INVALID).sum()


@pytest.mark.parametrize("name", NAMES)
def test_a_field_is_asked_in_the_unit_frame_through_its_file(name, fields, files):
    field, exported = fields[name], ExportedField("field", files[name])
    points = field.frame.to_unit(points_for(field))
    close = 2e-6 if field.keeps_length else closeness(name, field)
    found, wanted = exported.query(points), field.query(points)
    assert found.distance == pytest.approx(wanted.distance, abs=close)
    assert np.array_equal(found.flag, wanted.flag)
    for one, other in zip(exported.answer(points), found, strict=False):
        assert np.array_equal(one, other)
    assert exported.keeps_length == field.keeps_length
    if field.keeps_length:
        inside = points[(np.abs(points) <= 1).all(axis=1)]
        for one, other in zip(exported.direction(inside), field.direction(inside), strict=True):
            assert one == pytest.approx(other, abs=2e-6 * float(np.abs(other).max()))


@pytest.mark.parametrize("name", NAMES)
def test_in_other_units_and_elsewhere_a_file_answers_the_same(name, files):
    exported, factor = ExportedField("field", files[name]), 1000.0
    offset = np.array([3.0, -20.0, 0.5])
    points = points_for(exported)
    moved = exported.placed(factor, offset)
    distance, normal = exported.distance_and_normal(points)
    there, turned = moved.distance_and_normal(factor * (points + offset))
    # but on borders of cells, where rounding takes the other one
    assert (np.abs(there / factor - distance) > 1e-6).mean() < 0.01
    assert (np.linalg.norm(turned - normal, axis=1) > 1e-5).mean() < 0.01
    assert np.array_equal(exported.distance_and_normal(points)[0], distance)


def test_points_of_another_shape_are_refused_in_words(files):
    native = NativeField(files["sphere"])
    assert native.query([0.0, 0.0, 0.5]).distance == native.query([[0.0, 0.0, 0.5]]).distance
    for points in ([[1.0, 2.0]], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3.0, np.zeros((2, 3, 1))):
        for ask in (native.query, native.force, native.query_slopes):
            with pytest.raises(ValueError, match=r"points must be an array of shape \(n, 3\), not"):
                ask(points)


def test_a_file_weighs_what_its_answers_are_made_of(fields, files):
    """Without what only flags, scenes and readers of the provenance look at."""
    for name in ("exact", "compact", "nearest", "trilinear-normal", "spline", *SHAPES):
        assert NativeField(files[name]).bytes == fields[name].bytes
    assert NativeField(files["tricubic"]).bytes == 4 * 22**3
    for name in ("network", "gradient", "shallow", "network-16", "gradient-16"):
        own = fields[name.removesuffix("-16")]
        cells = len(own.base.coefficients) - 3 if own.base else None
        shape = len(own.layers[0][0]), len(own.layers) - 1, len(own.layers[-1][0])
        bits = 16 if name.endswith("-16") else 32
        assert NativeField(files[name]).bytes == network_bytes(*shape, base=cells, weight_bits=bits)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_place_gets_a_flag_and_no_force(name, fields, files):
    field = fields[name]
    bad = [np.nan, np.inf, -np.inf, 1e300, -1e300]
    centre = field.frame.to_mesh(np.full(3, 0.1))
    points = np.array([np.where(np.arange(3) == k, b, centre) for k in range(3) for b in bad])
    native = NativeField(files[name])
    answer = native.query(points)
    assert (answer.flag == INVALID).all()
    assert np.isnan(answer.distance).all()
    assert not native.force(points, k=1e3).any()
    tiny = native.query(np.array([[5e-324, -5e-324, 0.0]]))
    assert np.isfinite(tiny.distance).all()
    directions = np.random.default_rng(7).normal(size=(50, 3))
    for way in (1e9, 1e16, 1e20, 1e100, 1e149):
        far = native.query(way * directions)
        assert (far.flag == BOUND).all()
        assert not native.force(way * directions).any()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("small", [1e-320, 1.6e-162, 3e-162, 1e-155])
def test_normals_next_to_the_centre_have_unit_length(name, small, fields, files):
    native = NativeField(files[name])
    centre = np.array(native.frame.centre)
    points = centre + small * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]])
    answer = native.query(points)
    assert np.linalg.norm(answer.normal, axis=1) == pytest.approx(1, abs=1e-12)
    assert answer.distance == pytest.approx(native.query(centre[None]).distance[0], abs=1e-6)


WINDOWS = "x86_64-w64-mingw32-"
#: By language: the standards that are tried, and each compiler's name for it.
LANGUAGES = {
    "c": (("c99", "c11", "c17", "c2x"), {"gcc": "gcc", "clang": "clang", "mingw": f"{WINDOWS}gcc"}),
    "c++": (
        ("c++11", "c++14", "c++17", "c++20"),
        {"gcc": "g++", "clang": "clang++", "mingw": f"{WINDOWS}g++"},
    ),
}


@pytest.mark.parametrize("api", ["", "-DPANDIS_API=static inline"])
@pytest.mark.parametrize("compiler", ["gcc", "clang", "mingw"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_it_compiles_without_a_warning(compiler, language, api, tmp_path):
    standards, tools = LANGUAGES[language]
    tool = tools[compiler]
    if not shutil.which(tool):
        pytest.skip(f"no {tool} here")
    source = tmp_path / f"own.{'c' if language == 'c' else 'cpp'}"
    source.write_text(
        '#define PANDIS_IMPLEMENTATION\n#include "pandis.h"\n#include "pandis.h"\n'
        "int main(void) { pandis_field f; return !pandis_open(&f, 0, 0); }\n"
    )
    strict = [*STRICT, "-Wpedantic", *filter(None, [api])]
    for standard, level in zip(standards, ("-O0", "-O1", "-O2", "-O3"), strict=True):
        command = [tool, f"-std={standard}", level, *strict, source, "-lm", "-o", tmp_path / "own"]
        subprocess.run(command, check=True)
    if compiler != "mingw":
        subprocess.run([tmp_path / "own"], check=True)
    if platform.machine() == "x86_64":  # wider vectors, on whatever processor
        command[2:3] = ["-O3", "-mavx512f"]
        subprocess.run(command, check=True)


SETS = (
    ("-O0",),
    ("-O2",),
    ("-O3", "-march=x86-64-v3"),
    ("-O3", "-march=native"),
    ("-O3", "-DPANDIS_NO_VECTORS"),
    ("-O2", "-DPANDIS_NO_DISPATCH"),
    ("-O2", "-march=native", "-std=gnu11"),  # where products and sums are fused by default
)


@pytest.fixture(scope="module")
def points_file(fields, tmp_path_factory):
    """Return raw points for `probe`, of the torus's frame."""
    path = tmp_path_factory.mktemp("points") / "points.bin"
    path.write_bytes(points_for(fields["exact"], 500).astype(np.float64).tobytes())
    return path


def test_every_compiler_and_vector_width_gives_the_same_bits(files, points_file, tmp_path):
    """And nothing is allocated while queries are answered."""
    same_bits(files, points_file, tmp_path)


@pytest.mark.full
def test_every_compiler_and_vector_width_gives_the_same_ten_million_bits(files, fields, tmp_path):
    """Ten million answers of each, over all kinds of files."""
    path = tmp_path / "points.bin"
    points = points_for(fields["exact"], -(-10_000_000 // len(files)))
    path.write_bytes(points.astype(np.float64).tobytes())
    same_bits(files, path, tmp_path)


def same_bits(files, points, tmp_path):
    wraps = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc", "free")]
    seen = {}
    for compiler, flags in itertools.product(COMPILERS, SETS):
        program = tmp_path / "probe"
        command = [compiler, "-std=c99", "-D_POSIX_C_SOURCE=200809L", *flags]
        source = [HERE / "probe.c", "-lm", *wraps, "-o", program]
        done = subprocess.run([*command, "-I", ENGINE, *source], capture_output=True, check=False)
        if b"march" in done.stderr:
            continue  # another processor
        assert done.returncode == 0, done.stderr
        try:
            text = subprocess.run(
                [program, points, *files.values()], capture_output=True, text=True, check=True
            ).stdout
        except subprocess.CalledProcessError as error:
            if error.returncode == -4:
                continue  # instructions that this processor does not have
            raise
        seen[compiler, flags] = text
    assert len(seen) >= 3
    assert len(set(seen.values())) == 1, seen
    lines = next(iter(seen.values())).split("\n")[:-1]
    assert len(lines) == len(files)
    assert all(line.endswith(" 0") for line in lines)
    assert len(set(lines)) == len(lines) - 1  # with or without faces, a compact mesh is the same


@pytest.mark.parametrize("name", ["exact", "spline", "gradient", "tricubic", "box"])
def test_damage_is_found_and_named(name, files, tmp_path):
    data = files[name].read_bytes()
    path = tmp_path / "field.pandis"

    def refused(bad, why):
        path.write_bytes(bad)
        with pytest.raises(ArtifactError, match=why):
            NativeField(path)
        with pytest.raises(ArtifactError, match=why):
            NativeField(bytes(bad))

    rng = np.random.default_rng(1)
    for size in [8, 31, 200, 256, *rng.integers(257, len(data), 20)]:
        refused(data[:size], "shorter or longer")
    refused(data + b"12345678", "shorter or longer")
    for at in rng.integers(32, len(data), 40):
        refused(data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :], "damaged")
    refused(data[:28] + b"\1" + data[29:], "damaged")
    refused(b"", "not a .pandis file|cannot be read")
    refused(b"PK" + data[2:], "not a .pandis file")
    refused(data[:8] + data[8:12][::-1] + data[12:], "byte order of the file")
    for version in (0, 5):
        refused(data[:12] + struct.pack("<I", version) + data[16:], "differ in version")
    with pytest.raises(ArtifactError, match="cannot be read"):
        NativeField(tmp_path / "missing.pandis")


def resealed(data, offset, form, *values):
    """Return a file with some numbers changed and a checksum that is right."""
    changed = bytearray(data)
    struct.pack_into(form, changed, offset, *values)
    struct.pack_into("<I", changed, 24, zlib.crc32(bytes(changed[32:])))
    return bytes(changed)


def section(data, name):
    """Return where a section begins."""
    at = data.index(name, 256)
    return struct.unpack_from("<Q", data, at + 8)[0]


def test_what_does_not_fit_together_is_refused(files):
    """Each with a checksum that is right: indices that lead out of the file, sizes that lie."""
    held = {name: path.read_bytes() for name, path in files.items()}
    mesh, spline, network = held["exact"], held["spline"], held["gradient"]
    compact, faces = held["compact"], held["compact-faces"]
    originals = np.frombuffer(faces, np.int32)[section(faces, b"ORIG") // 4 :]
    unused = int(np.flatnonzero(originals == -1)[0])
    branch, block, pack = (section(compact, part) for part in (b"BRCH", b"BLCK", b"PACK"))
    (counts,) = struct.unpack_from("<I", compact, block + 4)
    cases = [
        resealed(compact, branch + 64, "<i", 0),  # a branch that is its own child
        resealed(compact, branch + 64, "<i", -(10**6)),
        resealed(compact, branch + 15, "<B", 9),
        resealed(compact, branch + 12, "<B", 32),
        resealed(compact, branch, "<i", -1),
        resealed(compact, block, "<I", 2**31),
        resealed(compact, block + 4, "<I", counts & ~(63 << 6)),  # one corner alone
        resealed(compact, block + 4, "<I", counts | 31 << 12),
        resealed(compact, block + 4, "<I", counts | 1 << 28),
        resealed(compact, block + 8, "<Q", 2**63),
        resealed(compact, pack + 48, "<Q", 2**64 - 1),  # corners beyond the last
        resealed(compact, 72, "<i", 21),
        resealed(compact, 72, "<i", 3),
        resealed(compact, 84, "<i", 10**6),
        resealed(faces, section(faces, b"ORIG"), "<i", -1),  # a face that comes from none
        resealed(faces, section(faces, b"ORIG") + 4 * unused, "<i", 0),
        resealed(faces, faces.index(b"ORIG", 256) + 16, "<Q", 256),  # of the first block alone
        resealed(mesh, section(mesh, b"FACE"), "<i", 10**6),
        resealed(mesh, section(mesh, b"NEIG"), "<i", -2),
        resealed(mesh, section(mesh, b"TREE") + 192, "<i", 0),  # a node that is its own child
        resealed(mesh, section(mesh, b"TREE") + 192, "<i", -(10**6)),
        resealed(mesh, section(mesh, b"LEAF") + 144, "<i", 10**6),
        resealed(mesh, section(mesh, b"LEAF") + 144, "<i", -1),  # a leaf without a face
        resealed(mesh, section(mesh, b"LEAF") + 148, "<i", -2),
        resealed(mesh, section(mesh, b"LEAF") + 176, "<f", np.nan),
        resealed(mesh, section(mesh, b"LEAF") + 188, "<f", 0.0),  # a lattice without steps
        resealed(mesh, section(mesh, b"LEAF") + 192, "<f", -1.0),
        resealed(mesh, section(mesh, b"LEAF") + 196, "<f", 0.5),
        resealed(mesh, section(mesh, b"VERT"), "<d", np.nan),
        resealed(spline, section(spline, b"BBRK"), "<H", 60000),
        resealed(spline, section(spline, b"BBAS"), "<I", 7),
        resealed(spline, section(spline, b"FMSK"), "<Q", 0),
        resealed(network, section(network, b"WHID"), "<f", np.inf),
        resealed(network, 72, "<i", 100_000),
        resealed(network, 76, "<i", -1),
        resealed(network, 64, "<d", 0.0),
        resealed(held["tricubic"], 76, "<i", 21),
        # corners of a grid's box: no number, out of the unit frame, in the wrong order, none at all
        resealed(held["trilinear-box"], 128, "<d", np.nan),
        resealed(held["trilinear-box"], 136, "<d", -1.5),
        resealed(held["nearest-box"], 152, "<d", 1.5),
        resealed(held["nearest-box"], 152, "<d", -0.95),
        held["trilinear"][:12] + struct.pack("<I", 2) + held["trilinear"][16:],
        held["tricubic"][:12] + struct.pack("<I", 2) + held["tricubic"][16:],
        resealed(held["box"], 72, "<i", 4),
        resealed(held["box"], 32, "<I", 7),
        resealed(held["box"], 36, "<I", 33),
        resealed(mesh, 256 + 8, "<Q", 2**63),
        resealed(mesh, 256 + 16, "<Q", 2**64 - 64),
        resealed(mesh, 256 + 4, "<I", 1),
        resealed(mesh, 256 + 8, "<Q", 0),
    ]
    for case in cases:
        with pytest.raises(ArtifactError, match="are inconsistent"):
            NativeField(case)


def test_a_tree_that_goes_round_or_too_deep_is_refused(files):
    """Shared children cost 8^n visits, a long chain the stack: nodes must come as they are met."""
    mesh = files["exact"].read_bytes()
    tree = section(mesh, b"TREE")
    children = list(struct.unpack_from("<8i", mesh, tree + 192))
    inner = [k for k, child in enumerate(children) if child > 0]
    assert len(inner) >= 2
    shared = children.copy()
    shared[inner[1]] = children[inner[0]]
    skipped = children.copy()
    skipped[inner[0]] += 1
    for bad in (shared, skipped):
        with pytest.raises(ArtifactError, match="are inconsistent"):
            NativeField(resealed(mesh, tree + 192, "<8i", *bad))


@needs_gcc
@pytest.mark.parametrize(
    "flags", [("-ffast-math",), ("-ffinite-math-only",), ("-freciprocal-math",), ("-mfpmath=387",)]
)
def test_it_does_not_compile_where_it_would_answer_wrongly(flags, tmp_path):
    command = ["gcc", "-std=c99", "-O2", *flags, "-I", ENGINE, "-c", HERE / "probe.c"]
    done = subprocess.run([*command, "-o", tmp_path / "p.o"], capture_output=True, check=False)
    assert done.returncode != 0
    assert b"pandis.h needs" in done.stderr


OPENS = """
#define PANDIS_IMPLEMENTATION
#include "pandis.h"
int main(int count, char **words) {
    pandis_field field;
    pandis_error error = count < 2 ? PANDIS_SUCCESS : pandis_open_file(&field, words[1]);
    puts(pandis_error_text(error));
    return -error;
}
"""


def opened_by(compiler, flags, path, folder):
    """Compile a program with flags, and return the error, without its sign, of opening a file.

    10, which says that arithmetic is broken, if it does not even compile for that.
    """
    source, program = folder / "opens.c", folder / "opens"
    source.write_text(OPENS)
    command = [compiler, "-std=c99", *flags, "-I", ENGINE, source, "-lm", "-o", program]
    made = subprocess.run(command, check=False, capture_output=True, text=True)
    if "pandis.h needs IEEE arithmetic" in made.stderr:
        return 10
    assert made.returncode == 0, made.stderr
    return subprocess.run([program, path], check=False, capture_output=True).returncode


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("level", ["-O2", "-O3"])
def test_broken_arithmetic_that_no_macro_shows_opens_nothing(compiler, level, files, tmp_path):
    """Under these flags 545 of 20,000 signs of a network's distances flipped."""
    broken = ["-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math"]
    for flags in (["-funsafe-math-optimizations"], broken):
        assert opened_by(compiler, [level, *flags], files["sphere"], tmp_path) == 10
    sound = ["-fno-math-errno", "-fno-trapping-math"]
    assert opened_by(compiler, [level, *sound], files["sphere"], tmp_path) == 0


@needs_gcc
def test_machines_with_half_precision_may_compile_it(tmp_path):
    """There FLT_EVAL_METHOD is 16, and float is still float."""
    source = tmp_path / "own.c"
    source.write_text(OPENS)
    tried = [("gcc", "-march=sapphirerapids"), ("aarch64-linux-gnu-gcc", "-march=armv8.2-a+fp16")]
    done = []
    for compiler, march in tried:
        if shutil.which(compiler):
            command = [compiler, "-std=gnu17", march, "-I", ENGINE, "-c", source]
            found = subprocess.run(
                [*command, "-o", tmp_path / "o"], capture_output=True, text=True, check=False
            )
            if "bad value" not in found.stderr:
                assert found.returncode == 0, found.stderr
                done.append(compiler)
    assert done or pytest.skip("no compiler here knows half precision")


def test_a_network_beyond_what_was_compiled_is_refused(files, tmp_path):
    small = ["-DPANDIS_MOST_WIDTH=8", "-DPANDIS_MOST_DEPTH=2"]
    for name, error in (("network", 11), ("exact", 0)):
        assert opened_by(COMPILERS[0], small, files[name], tmp_path) == error


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("level", ["-O0", "-O2", "-O3"])
def test_a_query_needs_little_stack(compiler, level, files, points_file, tmp_path):
    """Measured on a thread whose stack was painted: 8 KB, but for networks."""
    program = tmp_path / "stack"
    command = [compiler, "-std=c99", level, "-I", ENGINE, HERE / "stack.c", "-o", program]
    subprocess.run([*command, "-lpthread", "-lm"], check=True)
    for name, path in files.items():
        run = [program, path, points_file]
        used = int(subprocess.run(run, capture_output=True, text=True, check=True).stdout)
        network = name.startswith(("network", "gradient", "shallow"))
        assert 100 < used <= (90_000 if network else 8192), (name, used)


#: Machines on which a program gives the same bits: compiler, flags, what runs it.
TARGETS = {
    "i686": ("i686-linux-gnu-gcc", ("-msse2", "-mfpmath=sse"), ()),
    "aarch64": ("aarch64-linux-gnu-gcc", (), ("qemu-aarch64",)),
    "armhf": ("arm-linux-gnueabihf-gcc", ("-mfpu=neon",), ("qemu-arm",)),
    "windows": (f"{WINDOWS}gcc", (), ("/usr/lib/wine/wine64",)),
}


@needs_gcc
@pytest.mark.parametrize("target", TARGETS)
def test_other_machines_give_the_same_bits(target, files, points_file, tmp_path):
    other_machine(target, files, points_file, tmp_path)


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("target", TARGETS)
def test_other_machines_give_the_same_bits_100_000_times(target, files, fields, tmp_path):
    path = tmp_path / "points.bin"
    points = points_for(fields["exact"], 100_000)
    path.write_bytes(points.astype(np.float64).tobytes())
    other_machine(target, files, path, tmp_path)


def other_machine(target, files, points, folder):
    compiler, flags, runner = TARGETS[target]
    if not shutil.which(compiler) or not all(shutil.which(tool) for tool in runner):
        pytest.skip(f"no {compiler} here, or nothing that runs its programs")
    seen = []
    for own, more, by in (("gcc", (), ()), (compiler, flags, runner)):
        program = folder / f"probe-{own}.exe"
        command = [own, "-std=c99", "-O2", "-static", "-DNO_COUNT", *more]
        subprocess.run(
            [*command, "-I", ENGINE, HERE / "probe.c", "-lm", "-o", program],
            check=True, capture_output=True,
        )  # fmt: skip
        done = subprocess.run(
            [*by, program, points, *files.values()], capture_output=True, text=True, check=True,
            env=os.environ | {"WINEDEBUG": "-all"},
        )  # fmt: skip
        seen.append(done.stdout.split())
    assert seen[0] == seen[1]


@pytest.mark.skipif(not shutil.which("s390x-linux-gnu-gcc"), reason="no s390x compiler here")
@pytest.mark.skipif(not shutil.which("qemu-s390x"), reason="nothing here runs s390x programs")
def test_a_machine_of_the_other_byte_order_refuses(files, tmp_path):
    source, program = tmp_path / "own.c", tmp_path / "own"
    source.write_text(OPENS)
    command = ["s390x-linux-gnu-gcc", "-static", "-I", ENGINE, source, "-lm", "-o", program]
    subprocess.run(command, check=True)
    done = subprocess.run(
        ["qemu-s390x", program, files["sphere"]], capture_output=True, text=True, check=False
    )
    assert "byte order of the file" in done.stdout


@pytest.mark.skipif(not shutil.which(f"{WINDOWS}gcc"), reason="no mingw here")
@pytest.mark.skipif(not shutil.which("/usr/lib/wine/wine64"), reason="no wine here")
def test_paths_are_utf8_on_windows_too(files, tmp_path):
    shutil.copy(files["sphere"], tmp_path / "f\u00eb\U0001d11e.pandis")
    source, program = tmp_path / "own.c", tmp_path / "own.exe"
    name = '"f\\xc3\\xab" "\\xf0\\x9d\\x84\\x9e.pandis"'
    source.write_text(OPENS.replace("words[1]", name).replace("count < 2", "count < 1"))
    subprocess.run([f"{WINDOWS}gcc", "-I", ENGINE, source, "-o", program], check=True)
    done = subprocess.run(
        ["/usr/lib/wine/wine64", program], capture_output=True, text=True, check=False,
        cwd=tmp_path, env=os.environ | {"WINEDEBUG": "-all", "LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    assert "no error" in done.stdout


@pytest.mark.parametrize("name", ["box", "sphere", "trilinear", "spline", "network"])
def test_what_a_program_may_ask_of_a_field(name, files, fields, tmp_path):
    source, program = HERE / "asks.c", tmp_path / "asks"
    command = [COMPILERS[0], "-std=c99", "-O1", "-I", ENGINE, source, "-lm", "-o", program]
    subprocess.run(command, check=True)
    lines = subprocess.run(
        [program, files[name]], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert lines[0] == "-9"  # bytes that do not begin at a multiple of 8
    kind, size, longest, *bounds = lines[1].split()
    assert int(kind) == {"box": 5, "sphere": 5, "trilinear": 2, "spline": 3, "network": 1}[name]
    assert int(size) == files[name].stat().st_size
    frame = fields[name].frame
    assert float(longest) == pytest.approx(1.8 / frame.scale)
    low, high = np.array(bounds, float).reshape(3, 2).T
    assert (low < high).all()
    middle = frame.to_unit((low + high)[None] / 2)
    assert np.abs(middle).max() < 0.2
    assert json.loads(lines[2]) == {"of": name}
    # a stiffness that is none gives no force and says so; the last one is sound
    flags = np.array(lines[3].split(), int).reshape(4, 2)
    assert flags[:3].tolist() == [[2, 1]] * 3
    assert flags[3, 0] != 2
    slope = float(lines[4])
    wanted = {"box": 1.0, "sphere": 1.0, "trilinear": 0.0, "spline": 1.0}.get(name)
    assert wanted is None or slope == pytest.approx(wanted, abs=0.1)
    assert lines[5] == pandis.__version__


def test_the_header_carries_its_licence():
    lines = (ENGINE / "pandis.h").read_text().splitlines()
    text = " ".join(" ".join(line.removeprefix(" *") for line in lines).split())
    licence = (ROOT / "LICENSE").read_text()
    wanted = " ".join(licence.replace("MIT License", "").split())
    assert wanted in text


def test_an_open_file_may_be_overwritten(files, tmp_path):
    """What `cp new old` does, which keeps the file and changes its bytes."""
    path = tmp_path / "field.pandis"
    path.write_bytes(files["exact"].read_bytes())
    field = NativeField(path)
    before = field.query(np.zeros((1, 3))).distance
    with path.open("r+b") as stream:
        stream.write(b"\xff" * path.stat().st_size)
        stream.truncate(100)
    assert np.array_equal(field.query(np.zeros((1, 3))).distance, before)


def test_a_clock_needs_something_to_time(files):
    field = NativeField(files["sphere"])
    assert len(field.time([0.0, 0, 0], 5)) == 5
    for points, queries in ((np.zeros((0, 3)), 5), (np.zeros((1, 3)), 0)):
        with pytest.raises(ValueError, match="at least one"):
            field.time(points, queries)
        with pytest.raises(ValueError, match="at least one"):
            run_ticks(field, points, queries, rate=1000)


def fuzz(files, program, seconds):
    done = subprocess.run(
        [program, "fuzz", str(seconds), "1", *files.values()],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    print(done.stdout)
    runs, opened = (int(word) for word in done.stdout.split() if word.isdigit())
    assert 0 < opened < runs


def test_hostile_files_do_no_harm(files, sanitized):
    """Mutated files with right checksums, under address and undefined-behaviour sanitizers."""
    fuzz(files, sanitized, 20)


@pytest.mark.full
def test_hostile_files_do_no_harm_for_a_quarter_of_an_hour(files, sanitized):
    fuzz(files, sanitized, 900)


@pytest.mark.full
@pytest.mark.skipif(not shutil.which("clang"), reason="no clang here: apt-get install clang")
def test_libfuzzer_finds_nothing_in_a_quarter_of_an_hour(files, tmp_path):
    """Guided by coverage, from small files of every kind."""
    program, corpus = tmp_path / "fuzz", tmp_path / "corpus"
    command = ["clang", "-std=c99", "-g", "-O1", "-fsanitize=fuzzer,address,undefined"]
    command += ["-fno-sanitize-recover=all", "-D_POSIX_C_SOURCE=200809L", "-DLIBFUZZER"]
    done = subprocess.run(
        [*command, "-I", ENGINE, HERE / "fuzz.c", "-lm", "-o", program],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "fuzzer" in done.stderr and done.returncode:
        pytest.skip("this clang has no libFuzzer: apt-get install libclang-rt-dev")
    assert done.returncode == 0, done.stderr
    corpus.mkdir()
    for name, path in files.items():
        shutil.copy(path, corpus / name)
    limits = [
        "-max_total_time=900",
        "-max_len=900000",
        "-rss_limit_mb=4096",
        "-print_final_stats=1",
    ]
    done = subprocess.run([program, *limits, corpus], capture_output=True, text=True, check=False)
    print(done.stderr[-2000:])
    assert done.returncode == 0, done.stderr[-5000:]


def test_sixteen_bits_cost_little(fields, meshes):
    field = fields["gradient"]
    said = []
    data = export_native(
        field,
        Body.open(meshes["exact"]),
        NativeOptions(weight_bits=16),
        provenance={},
        log=said.append,
    )
    whole = export_native(
        field, Body.open(meshes["exact"]), NativeOptions(), provenance={}, log=said.append
    )
    assert len(data) < 0.75 * len(whole)
    points = points_for(field)
    one, other = NativeField(data), NativeField(whole)
    off = np.abs(one.query(points).distance - other.query(points).distance).max()
    assert 0 < off * field.frame.scale < 2e-3
    assert "16-bit weights change the answers" in said[0]


def test_a_broken_sixteen_bit_export_is_refused(fields, meshes, monkeypatch):
    field = fields["gradient"]
    data = native_bytes(field, {}, 16)
    broken = resealed(data, section(data, b"SCAL"), "<f", 0.1)
    monkeypatch.setattr("pandis.pipeline.kinds.native.pack", lambda *_, **__: broken)
    with pytest.raises(pandis.base.errors.PandisError, match="differs from its field"):
        export_native(
            field,
            Body.open(meshes["exact"]),
            NativeOptions(weight_bits=16),
            provenance={},
            log=print,
        )


def test_an_export_that_differs_from_its_field_is_refused(fields, meshes, monkeypatch):
    """The check must notice: here a bias is lost on the way."""
    field = fields["network"]
    data = native_bytes(field, {})
    at = section(data, b"BIAS")
    broken = resealed(data, at, "<f", 3.0)
    monkeypatch.setattr("pandis.pipeline.kinds.native.pack", lambda *_, **__: broken)
    with pytest.raises(pandis.base.errors.PandisError, match="differs from its field"):
        export_native(field, Body.open(meshes["exact"]), NativeOptions(), provenance={}, log=print)


def test_provenance_travels_with_the_file(files, tmp_path):
    assert read_provenance(files["exact"]) == {"of": "exact"}
    assert read_provenance(files["gradient"]) == {"of": "gradient"}
    with pytest.raises(ArtifactError):
        read_provenance(tmp_path / "none.pandis")


def test_a_user_loads_a_field_and_asks_for_forces(files, fields):
    field = pandis.load(files["sphere"])
    assert field.force([[0.0, 0.0, 0.9]], k=100) == pytest.approx(np.array([[0, 0, 10.0]]))
    assert field.force([0.0, 0.0, 1.1]).tolist() == [[0, 0, 0]]
    taken = field.time(np.zeros((3, 3)), 500)
    assert (taken >= 0).all()
    assert fields["sphere"].bytes == 0


def test_the_format_is_as_documented():
    """What docs/format.md says of the header, byte by byte."""
    from pandis.base.frame import Frame

    frame = Frame((1.0, 2.0, 3.0), 0.5)
    data = pack(frame, Parts(5, [0], [2.0], {}), {})
    assert data[:8] == b"PANDIS\r\n"
    assert struct.unpack_from("<IIQI", data, 8) == (0x0A0B0C0D, 1, len(data), zlib.crc32(data[32:]))
    assert struct.unpack_from("<II3dd", data, 32) == (5, 1, 1.0, 2.0, 3.0, 0.5)
    assert struct.unpack_from("<14i", data, 72)[0] == 0
    assert struct.unpack_from("<16d", data, 128)[0] == 2.0
    name, _, start, size = struct.unpack_from("<4sIQQ", data, 256)
    assert (name, start % 64, data[start : start + size]) == (b"PROV", 0, b"{}")


@needs_cpp
@pytest.mark.parametrize(
    "name", [name for name in NAMES if name not in ("network", "shallow")]
)  # trained too little
def test_the_examples_come_to_rest_where_the_weight_is_held(name, files, tmp_path):
    """A probe of 50 g on a wall of 400 N/m, on every kind of field: 0.4905 N, twice."""
    program, examples = tmp_path / "servo", ROOT / "docs/examples"
    command = ["g++", "-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", "-I", ENGINE]
    subprocess.run([*command, examples / "servo.cpp", "-o", program], check=True)
    for run in ([program], [sys.executable, examples / "servo.py"]):
        done = subprocess.run(
            [*run, files[name], "400"], capture_output=True, text=True, check=True,
            env=os.environ | {"PYTHONPATH": str(ENGINE.parents[1])},
        )  # fmt: skip
        held = float(re.search(r"held with ([-0-9.]+) N", done.stdout)[1])
        assert held == pytest.approx(0.4905, rel=0.01 if name != "nearest" else 0.05), done.stdout
        if name in ("box", "sphere", "exact"):
            assert "1.2" in done.stdout

"""Random damage: each mesh ends valid or is refused in plain words, never anything else.

Case ``n`` is made from seed ``n`` alone. `make test` runs the first 60 and every
case that ever failed; `make test-full` runs 2,000.
"""

import numpy as np
import pytest

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh import repair, tools
from pandis.pipeline.mesh.formats import FormatError
from pandis.pipeline.mesh.intake import check_arrays
from pandis.pipeline.mesh.processes import ToolError
from pandis.pipeline.run.ask.options import MeshOptions
from support import box_mesh, octahedron
from test_diagnosis import copies
from test_repair import ball
from validity import assert_valid

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow

#: Cases that once failed.
FAILED_ONCE = [873]
#: Rungs that are our own code run in this process, the others as always in their own.
OURS = ("clean", "orient", "split", "fill", "remesh")


def sound(rng):
    """Return a sound small mesh."""
    torus = SHAPES["torus"].tessellation(16, 8)
    nested = copies(box_mesh(), (box_mesh()[0] / 2, box_mesh()[1][:, ::-1]))
    bases = (octahedron(), ball(1), ball(2), box_mesh(), torus, nested, copies(ball(1), torus))
    vertices, faces = bases[rng.integers(len(bases))]
    return vertices.astype(float), np.asarray(faces, np.int64)


def some(rng, faces, share=0.1):
    return rng.choice(len(faces), max(1, int(rng.random() * share * len(faces))), replace=False)


def drop(rng, vertices, faces):
    return vertices, np.delete(faces, some(rng, faces), axis=0)


def flip(rng, vertices, faces):
    faces = faces.copy()
    chosen = some(rng, faces, 0.5)
    faces[chosen] = faces[chosen][:, ::-1]
    return vertices, faces


def duplicate(rng, vertices, faces):
    extra = faces[some(rng, faces)]
    return vertices, np.concatenate([faces, extra if rng.random() < 0.5 else extra[:, ::-1]])


def jitter(rng, vertices, faces):
    amount = 10.0 ** rng.uniform(-9, -0.5)
    return vertices + rng.normal(0, amount, vertices.shape), faces


def swap_corners(rng, vertices, faces):
    faces = faces.copy()
    for f in some(rng, faces, 0.05):
        faces[f, rng.integers(3)] = rng.integers(len(vertices))
    return vertices, faces


def swap_vertices(rng, vertices, faces):
    vertices = vertices.copy()
    a, b = rng.choice(len(vertices), 2, replace=False)
    vertices[[a, b]] = vertices[[b, a]]
    return vertices, faces


def merge(rng, vertices, faces):
    vertices = vertices.copy()
    a, b = rng.choice(len(vertices), 2, replace=False)
    vertices[a] = vertices[b]
    return vertices, faces


def spoil(rng, vertices, faces):
    vertices = vertices.copy()
    vertices[rng.integers(len(vertices)), rng.integers(3)] = rng.choice([np.nan, np.inf])
    return vertices, faces


def scale(rng, vertices, faces):
    return vertices * 10.0 ** rng.uniform(-9, 9) + 0.0, faces


def soup(rng, vertices, faces):
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def overlap(rng, vertices, faces):
    return copies((vertices, faces), (vertices + rng.uniform(-1, 1, 3) * np.ptp(vertices), faces))


DAMAGES = (
    drop, flip, duplicate, jitter, swap_corners, swap_vertices, merge, spoil, scale, soup, overlap,
)  # fmt: skip


def damaged(seed):
    """Return the mesh and the options of a case."""
    rng = np.random.default_rng(seed)
    vertices, faces = sound(rng)
    with np.errstate(invalid="ignore"):  # a spoilt vertex may be spoilt further
        for _ in range(rng.integers(1, 4)):
            vertices, faces = DAMAGES[rng.integers(len(DAMAGES))](rng, vertices, faces)
    rungs = ["clean", "union", "fill", "meshfix"]
    rungs += ["remesh", "wrap"] if seed % 100 == 7 else []
    options = {"open": str(rng.choice(["refuse", "cap", "cap", "cap"])), "rungs": rungs}
    return vertices, faces, MeshOptions(**options)


def check(seed, monkeypatch):
    honest = tools.call

    def call(operation, vertices, faces, *, seconds, memory_gb, cpu=None, **parameters):
        if operation not in OURS:
            limits = {"seconds": seconds, "memory_gb": memory_gb, "cpu": cpu}
            return honest(operation, vertices, faces, **limits, **parameters)
        try:
            return tools.OPERATIONS[operation](vertices, faces, **parameters)
        except ValueError as error:  # as the child process would report it
            raise ToolError(str(error)) from error

    monkeypatch.setattr(tools, "call", call)
    vertices, faces, options = damaged(seed)
    try:
        check_arrays(vertices, faces)
        arrays, record = repair.repair(vertices, faces, options, seed=0, log=lambda text: None)
    except (PandisError, ToolError, FormatError):
        return "refused"
    assert record["after"]["valid"]
    assert_valid(arrays["vertices"], arrays["faces"], points=1000)
    return "valid"


@pytest.mark.parametrize("seed", [*range(60), *FAILED_ONCE])
def test_damage_ends_valid_or_refused(seed, monkeypatch):
    check(seed, monkeypatch)


@pytest.mark.full
@pytest.mark.parametrize("hundred", range(20))
def test_much_damage_ends_valid_or_refused(hundred):
    outcomes = []
    for seed in range(100 * hundred, 100 * hundred + 100):
        try:
            with pytest.MonkeyPatch.context() as patch:
                outcomes.append(check(seed, patch))
        except Exception as error:
            raise AssertionError(f"case {seed}: {error}") from error
    assert outcomes.count("valid") > 25

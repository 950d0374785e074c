"""Repair: known answers, every fault class, the deviation budget, refusals in plain words."""

import subprocess

import igl
import numpy as np
import pytest
import yaml

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.shapes import SHAPES
from pandis.pipeline.mesh import holes, tools
from pandis.pipeline.mesh import repair as ladder
from pandis.pipeline.mesh.build import build
from pandis.pipeline.mesh.cleanup import clean, flip_flat_faces, orient, split
from pandis.pipeline.mesh.deviation import Surface, deviation
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.holes import fill_holes
from pandis.pipeline.mesh.intake import read_mesh
from pandis.pipeline.mesh.processes import LimitError, ToolError
from pandis.pipeline.mesh.remesh import orient_by_sight, winding_remesh
from pandis.pipeline.run.ask.options import MeshOptions
from pandis.pipeline.run.ask.tasks import MeshTask
from support import box_mesh, octahedron
from test_diagnosis import copies
from validity import assert_valid, volume


def fix(vertices, faces, **options):
    """Repair; return vertices, faces, the record and the names of what was kept."""
    arrays, record = ladder.repair(
        vertices, np.asarray(faces, np.int64), MeshOptions(**options), seed=0, log=lambda text: None
    )
    kept = [rung["operation"] for rung in record["rungs"] if rung["kept"]]
    return arrays["vertices"], arrays["faces"], record, kept


def ball(level=3, radius=1.0, centre=(0.0, 0.0, 0.0)):
    vertices, faces = octahedron()
    for _ in range(level):
        vertices, faces = igl.upsample(vertices, faces.astype(np.int64), 1)
        vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices * radius + centre, faces


# --- nothing, and what loses nothing -----------------------------------------------------


def test_valid_mesh_passes_bit_identical():
    vertices, faces = box_mesh()
    vertices = vertices + np.random.default_rng(0).normal(0, 1e-3, vertices.shape)
    fixed, fixed_faces, record, kept = fix(vertices, faces)
    assert fixed.tobytes() == vertices.tobytes()
    assert np.array_equal(fixed_faces, faces)
    assert record["rungs"] == kept == []
    assert record["deviation"]["to_result"]["max"] == 0


def test_stray_vertices_alone_are_dropped():
    vertices, faces = box_mesh()
    fixed, fixed_faces, _, kept = fix(np.concatenate([[[np.nan] * 3], vertices]), faces + 1)
    assert fixed.tobytes() == vertices.tobytes()
    assert np.array_equal(fixed_faces, faces)
    assert kept == []


def test_soup_equals_its_welded_self():
    vertices, faces = box_mesh()
    soup = vertices[faces].reshape(-1, 3)
    fixed, fixed_faces, record, kept = fix(soup, np.arange(len(soup)).reshape(-1, 3))
    assert kept == ["clean"]
    assert np.array_equal(fixed[fixed_faces], vertices[faces])
    assert_valid(fixed, fixed_faces)
    assert record["deviation"]["untouched"] == 1


def test_last_bit_cracks_are_welded_by_tolerance():
    vertices, faces = octahedron()
    soup = vertices[faces].reshape(-1, 3)
    soup = soup + np.random.default_rng(1).uniform(-1, 1, soup.shape) * 1e-10
    fixed, fixed_faces, record, _ = fix(soup, np.arange(24).reshape(-1, 3))
    assert_valid(fixed, fixed_faces)
    assert len(fixed) == 6
    assert 0 < record["deviation"]["to_result"]["max"] < 1e-9


def test_every_pair_within_the_tolerance_is_welded():
    """A lattice would part one pair in seven at a sixth of the tolerance."""
    rng = np.random.default_rng(0)
    base = rng.uniform(-1, 1, (2000, 3))
    offset = rng.normal(size=base.shape)
    offset *= 1e-9 / np.linalg.norm(offset, axis=1, keepdims=True)
    vertices = np.concatenate([base, base + offset])
    faces = np.arange(2000).reshape(-1, 2)
    faces = np.concatenate([faces, faces[::-1, :1] + 2000], axis=1)  # mixes both copies
    kept, _ = clean(vertices, faces, tolerance=1.7e-9)
    gaps = np.linalg.norm(kept[:, None] - kept[None], axis=2)[~np.eye(len(kept), dtype=bool)]
    assert gaps.min() > 1.7e-9


def test_doubles_degenerates_and_strays_are_dropped():
    vertices, faces = octahedron()
    dirty = np.concatenate([faces, [[0, 0, 2]], faces[3:4, ::-1], faces[3:4]])
    fixed, fixed_faces, record, _ = fix(np.concatenate([vertices, [[9.0, 9, 9]]]), dirty)
    assert_valid(fixed, fixed_faces)
    assert len(fixed_faces) == 8
    assert len(fixed) == 6
    assert record["before"]["duplicate_faces"] == 2
    assert record["before"]["degenerate_faces"] == 1


def test_doubles_that_face_the_same_way_go_before_anything_else():
    """All faces twice: each has a copy, and without the copies the mesh is closed."""
    vertices, faces = octahedron()
    second = copies((vertices, faces), (vertices, faces))
    fixed, fixed_faces, _, kept = fix(*second)
    assert_valid(fixed, fixed_faces)
    assert kept == ["clean"]
    assert volume(fixed, fixed_faces) == pytest.approx(4 / 3)


def test_flat_faces_are_flipped_away():
    """A corner in the middle of its neighbour's edge: no area, no normal, no place for it."""
    vertices, faces = octahedron()
    middle = len(vertices)
    vertices = np.concatenate([vertices, [[0.5, 0.5, 0.0]]])  # on the edge of vertices 0 and 2
    faces = np.concatenate([faces[1:], [[0, middle, 4], [middle, 2, 4], [0, 2, middle]]])
    assert diagnose(vertices, faces).degenerate_faces == 1
    flipped = flip_flat_faces(vertices, faces)
    assert len(flipped) == len(faces)
    assert_valid(vertices, flipped)
    fixed, fixed_faces, record, _ = fix(vertices, faces)
    assert_valid(fixed, fixed_faces)
    assert record["deviation"]["to_result"]["max"] < 1e-15


def test_clean_keeps_bits_and_order():
    vertices, faces = box_mesh()
    kept, kept_faces = clean(vertices, faces)
    assert kept.tobytes() == vertices.tobytes()
    assert np.array_equal(kept_faces, faces)
    kept, _ = clean(np.concatenate([[[7.0, 7, 7]], vertices]), faces + 1)
    assert kept.tobytes() == vertices.tobytes()


# --- orientation -------------------------------------------------------------------------


def test_inside_out_is_turned():
    vertices, faces = box_mesh()
    fixed, fixed_faces, record, kept = fix(vertices, faces[:, ::-1])
    assert record["before"]["volume"] < 0 < record["after"]["volume"]
    assert kept == ["orient"]
    assert_valid(fixed, fixed_faces)


def test_random_flips_are_made_consistent():
    vertices, faces = box_mesh()
    faces = faces.copy()
    some = np.random.default_rng(2).random(len(faces)) < 0.3
    faces[some] = faces[some][:, ::-1]
    fixed, fixed_faces, record, _ = fix(vertices, faces)
    assert record["before"]["orientation_conflicts"] > 0
    assert_valid(fixed, fixed_faces)


@pytest.mark.parametrize("turned", [False, True])
def test_cavity_stays_a_cavity_and_island_an_island(turned):
    vertices, faces = box_mesh()
    inner = faces[:, ::-1] if turned else faces
    nested = copies((vertices, faces), (vertices * 0.5, inner), (vertices * 0.25, faces))
    fixed, fixed_faces, record, _ = fix(*nested)
    assert_valid(fixed, fixed_faces)
    assert volume(fixed, fixed_faces) == pytest.approx(2.8 * (1 - 0.5**3 + 0.25**3))
    assert record["after"]["cavities"] == 1
    if not turned:
        fixed, fixed_faces, _, kept = fix(*nested, nested="solid")
        assert "union" in kept
        assert volume(fixed, fixed_faces) == pytest.approx(2.8)
        assert_valid(fixed, fixed_faces)


def test_sphere_with_a_spherical_cavity_keeps_it():
    outer, inner = ball(), ball(radius=0.5)
    shells = copies(outer, (inner[0], inner[1][:, ::-1]))
    fixed, fixed_faces, _, kept = fix(*shells)
    assert kept == []
    assert fixed.tobytes() == shells[0].tobytes()
    assert_valid(fixed, fixed_faces)


def test_sight_tells_front_from_back_where_nothing_is_closed():
    vertices, faces = ball(2)
    half = faces[vertices[faces][:, :, 2].mean(axis=1) > -0.3]
    # six domes side by side
    domes = copies(*((vertices + [3.0 * k, 0, 0], half) for k in range(6)))
    for size in (1.0, 1e-9):
        for given in (domes[1], domes[1][:, ::-1]):
            assert np.array_equal(orient_by_sight(domes[0] * size, given), domes[1])


# --- union -------------------------------------------------------------------------------


def test_two_overlapping_spheres_become_their_union():
    two = copies(ball(4), ball(4, centre=(1.0, 0, 0)))
    fixed, fixed_faces, record, kept = fix(*two)
    assert kept == ["union"]
    assert_valid(fixed, fixed_faces)
    # two unit balls at distance 1 less their common lens: 7.07; the inscribed meshes have less
    lens = 5 * np.pi / 12
    share = volume(*ball(4)) / (4 * np.pi / 3)
    assert volume(fixed, fixed_faces) == pytest.approx(share * (8 * np.pi / 3 - lens), rel=1e-3)
    moved = record["deviation"]
    assert moved["to_result"]["hidden"] == pytest.approx(
        0.25, abs=0.01
    )  # the walls inside are gone, and not counted
    assert moved["to_result"]["max"] < 1e-3
    assert moved["to_source"]["max"] < 1e-9


def test_a_cavity_survives_a_union():
    shells = copies(
        ball(3), ball(3, centre=(1.0, 0, 0)), (ball(2, 0.2)[0] - [0.5, 0, 0], ball(2)[1][:, ::-1])
    )
    fixed, fixed_faces, record, kept = fix(*shells)
    assert "union" in kept
    assert record["after"]["cavities"] == 1
    assert_valid(fixed, fixed_faces)


@pytest.mark.parametrize(
    "shift", [(2.0, 0, 0), (1.0, 1.0, 0), (1.0, 0.3, 0.7)], ids=["vertex", "edge", "inside"]
)
def test_solids_that_meet_are_made_manifold(shift):
    """Two octahedra that share a corner, an edge, or overlap."""
    vertices, faces = octahedron()
    fixed, fixed_faces, record, _ = fix(*copies((vertices, faces), (vertices + shift, faces)))
    assert_valid(fixed, fixed_faces)
    assert record["deviation"]["to_source"]["max"] < 1e-6
    if shift[2] == 0:
        assert volume(fixed, fixed_faces) == pytest.approx(8 / 3, rel=1e-5)


def test_two_boxes_that_touch_along_an_edge_are_parted():
    vertices, faces = SHAPES["box"].tessellation(2)
    both = copies((vertices, faces), (vertices + [2.0, 1.4, 0], faces))
    fixed, fixed_faces, _, kept = fix(*both)
    assert "split" in kept
    assert_valid(fixed, fixed_faces)
    assert volume(fixed, fixed_faces) == pytest.approx(2 * volume(vertices, faces), rel=1e-5)
    assert diagnose(fixed, np.asarray(fixed_faces, np.int64)).components == 2


def test_an_edge_whose_wedges_meet_again_is_halved():
    """A box with a notch up to its edge: four faces at an edge, all of one fan at both ends."""
    vertices, faces = SHAPES["box"].tessellation(4)
    ends = vertices.copy()
    # bring the middle of an upper edge down to the edge below it
    top = np.flatnonzero((vertices[:, 0] == 1) & (vertices[:, 2] == 0.5))
    low = np.flatnonzero((vertices[:, 0] == 1) & (vertices[:, 2] == -0.5))
    middle = top[np.isin(vertices[top, 1], [-0.35, 0.0])]
    for v in middle:
        ends[v] = vertices[low[vertices[low, 1] == vertices[v, 1]][0]]
    pinched = clean(ends, np.asarray(faces, np.int64))
    assert diagnose(*pinched).nonmanifold_edges == 1
    assert not diagnose(*split(*orient(*pinched))).nonmanifold_edges


# --- holes -------------------------------------------------------------------------------


def test_small_hole_is_filled_and_nothing_else_moves():
    vertices, faces = box_mesh()
    fixed, fixed_faces, record, kept = fix(vertices, np.delete(faces, [0, 16], axis=0))
    assert kept == ["fill"]
    assert_valid(fixed, fixed_faces)
    assert fixed.tobytes() == vertices.tobytes()
    assert volume(fixed, fixed_faces) == pytest.approx(2.8, rel=0.02)
    assert record["deviation"]["to_result"]["max"] == 0
    assert record["deviation"]["untouched"] == 1


def test_flat_hole_is_filled_flat_and_a_folded_one_without_crossing():
    vertices, faces = box_mesh()
    top = (vertices[faces][:, :, 2] == 0.5).all(axis=1)
    _, filled = fill_holes(vertices, np.asarray(faces[~top], np.int64))
    assert_valid(vertices[np.unique(filled)], np.unique(filled, return_inverse=True)[1])
    assert volume(vertices, filled) == pytest.approx(2.8)
    corner = (vertices[faces] > [0.3, 0.2, 0.1]).all(axis=2).all(axis=1)
    _, filled = fill_holes(vertices, np.asarray(faces[~corner], np.int64))
    assert not diagnose(vertices, filled).self_intersections


@pytest.mark.slow
def test_large_hole_is_refused_with_the_option_that_would_fill_it():
    vertices, faces = box_mesh()
    top = (vertices[faces][:, :, 2] == 0.5).all(axis=1)
    with pytest.raises(PandisError, match=r"the mesh is open.*mesh: {open: cap}"):
        fix(vertices, faces[~top])
    for options in ({"open": "cap"}, {"small_hole": 3.0}):
        fixed, fixed_faces, record, _ = fix(vertices, faces[~top], **options)
        assert_valid(fixed, fixed_faces)
        assert volume(fixed, fixed_faces) == pytest.approx(2.8)
        assert record["deviation"]["to_source"]["caps"] > 0.2
        assert record["deviation"]["to_source"]["max"] < 1e-3
    with pytest.raises(PandisError, match=r"mesh: {open: cap}"):
        fix(vertices, faces[~top], small_hole=3.0, max_hole_edges=3)


@pytest.mark.slow
def test_a_sheet_is_refused_and_made_a_wall_on_request():
    n = 12
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.sin(x.ravel() / 4)], axis=1)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([a, a + n + 1, a + 1], 1),
                            np.stack([a + 1, a + n + 1, a + n + 2], 1)])  # fmt: skip
    with pytest.raises(PandisError, match=r"no solid behind.*mesh: {open: thicken}"):
        fix(vertices, faces)
    fixed, fixed_faces, record, kept = fix(vertices, faces, open="thicken", thickness=0.04)
    assert kept == ["wrap"]
    assert_valid(fixed, fixed_faces)
    wall = 0.04 * record["before"]["diagonal"]
    assert volume(fixed, fixed_faces) == pytest.approx(wall * record["before"]["area"], rel=0.1)


# --- the last rungs ------------------------------------------------------------------------


@pytest.mark.slow
def test_remesh_closes_what_no_other_rung_can():
    """A fin inside, a hole, a part turned: only the winding number still knows the inside."""
    vertices, faces = ball(4)
    faces = np.delete(faces, np.arange(40), axis=0)
    inner = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0.1]])
    vertices = np.concatenate([vertices, inner])
    faces = np.concatenate([faces, [[len(vertices) - 3, len(vertices) - 2, len(vertices) - 1]]])
    fixed, fixed_faces = winding_remesh(vertices, faces, 7)
    assert_valid(fixed, fixed_faces)
    assert volume(fixed, fixed_faces) == pytest.approx(4 * np.pi / 3, rel=0.02)


def test_meshfix_repairs_component_by_component():
    one, two = ball(3), ball(3, centre=(3.0, 0, 0))
    both = copies((one[0], one[1][5:]), (two[0], two[1][:-9]))
    fixed, fixed_faces = tools.call("meshfix", *both, seconds=100, memory_gb=3)
    assert_valid(fixed, fixed_faces)
    assert diagnose(fixed, fixed_faces).components == 2
    assert np.isin(fixed[:, 0], both[0][:, 0]).mean() > 0.9  # unmoved ones have their bits


def test_rungs_are_the_users_choice():
    two = copies(ball(2), ball(2, centre=(1.0, 0, 0)))
    with pytest.raises(PandisError, match=r"cross or touch.*mesh\.rungs: add union"):
        fix(*two, rungs=["clean"])
    vertices, faces = ball(3)
    fixed, fixed_faces, _, kept = fix(vertices, faces[1:], rungs=["meshfix"])
    assert kept == ["meshfix"]
    assert_valid(fixed, fixed_faces)
    with pytest.raises(PandisError, match=r"boundary edges.*add clean, union, fill, meshfix"):
        fix(vertices, faces[1:], rungs=[])


@pytest.mark.slow
def test_a_result_beyond_the_budget_is_not_kept(monkeypatch):
    """A spike that a remesh would cut off: with the budget at zero, no rung may."""
    monkeypatch.setattr(ladder, "REMESH_LEVELS", (7,))
    vertices, faces = ball(3)
    inner = np.array([[0.0, 0, 0.5], [0, 0.2, 1.5], [0.2, 0, 1.5]])
    fin = np.array([[0, 1, 2]]) + len(vertices)
    spiked = np.concatenate([vertices, inner]), np.concatenate([faces, fin])
    options = {"open": "cap", "rungs": ["clean", "remesh"]}
    with pytest.raises(PandisError, match=r"deviation to result: p99 .* mesh\.deviation_p99 is"):
        fix(*spiked, **options)
    fixed, fixed_faces, record, _ = fix(*spiked, **options, deviation_max=1.0, deviation_p99=1.0)
    assert_valid(fixed, fixed_faces)
    assert record["deviation"]["to_result"]["max"] > 0.3


@pytest.mark.full
def test_a_rung_that_would_hollow_the_body_is_not_kept():
    """Through a hole wider than alpha a wrap enters: a shell within the budget, and wrong."""
    vertices, faces = ball(4)
    opened = faces[(vertices[faces][:, :, 2] < 0.9).all(axis=1)]
    with pytest.raises(PandisError, match="of the inside would be added or lost"):
        fix(vertices, opened, open="cap", rungs=["clean", "wrap"])


def test_a_rung_at_its_limit_fails_and_names_the_option():
    two = copies(ball(4), ball(4, centre=(1.0, 0, 0)))
    with pytest.raises(
        PandisError, match=r"longer than 0.2 s; raise mesh\.rung_seconds, or leave this rung out"
    ):
        fix(*two, rung_seconds=0.2)


def test_a_rung_out_of_memory_fails_and_names_the_option(monkeypatch):
    def call(*_, **__):
        raise LimitError("needs more than 1 GB of memory")

    monkeypatch.setattr(tools, "call", call)
    with pytest.raises(PandisError, match=r"raise mesh\.rung_memory_gb, or leave this rung out"):
        fix(*copies(ball(1), ball(1, centre=(1.0, 0, 0))))


@pytest.mark.slow
def test_a_rung_whose_package_is_missing_is_not_passed_over(monkeypatch, tmp_path):
    """The next rung would give a different mesh from the one with the package installed."""
    (tmp_path / "pymeshfix.py").write_text("import a_package_that_is_missing")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    vertices, faces = ball(2)
    with pytest.raises(PandisError, match=r"meshfix needs a package: No module named") as refused:
        fix(vertices, faces[1:], rungs=["meshfix", "remesh"])
    left = yaml.safe_load(str(refused.value).partition("mesh.rungs: ")[2])
    assert left == ["remesh"]
    assert fix(vertices, faces[1:], rungs=left)[3] == ["remesh"]


@pytest.mark.slow
def test_a_crash_of_a_rung_is_recorded_and_passed(monkeypatch):
    honest = tools.call

    def call(operation, *arguments, **options):
        if operation == "union":
            raise ToolError("crashed (signal 11)")
        return honest(operation, *arguments, **options)

    monkeypatch.setattr(tools, "call", call)
    two = copies(ball(3), ball(3, centre=(1.0, 0, 0)))
    fixed, fixed_faces, record, kept = fix(*two)
    assert "failed: crashed (signal 11)" in [rung["reason"] for rung in record["rungs"]]
    assert kept == ["remesh"]
    assert_valid(fixed, fixed_faces)


# --- deviation -----------------------------------------------------------------------------


def test_deviation_sees_faces_not_vertices_only():
    """One skew quad, its diagonal flipped: equal vertices, distance 0.57."""
    vertices = np.array([[0, 0, 0], [1, 0, 1], [1, 1, 0], [0, 1, 1.0]])
    one, other = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1, 3], [1, 2, 3]])
    found = deviation(Surface(vertices, one), Surface(vertices.copy(), other), seed=0)
    assert found["to_result"]["max"] == pytest.approx(0.577, abs=0.02)
    assert found["untouched"] == 1
    same = deviation(Surface(vertices, one), Surface(vertices, one), 0)
    assert same["to_source"]["max"] == same["to_source"]["mean"] == 0


def test_deviation_is_that_of_an_offset():
    found = deviation(Surface(*ball(5)), Surface(*ball(5, radius=1.01)), seed=0)
    for way in ("to_result", "to_source"):
        assert found[way]["mean"] == pytest.approx(0.01, rel=0.01)
    assert found["to_result"]["hidden"] == found["to_source"]["caps"] == found["untouched"] == 0


def test_origin_of_every_face():
    vertices, faces = ball(3)
    arrays, _ = ladder.repair(vertices, faces[4:], MeshOptions(), seed=0, log=lambda text: None)
    assert (arrays["origin"] == 0).sum() == len(faces) - 4
    assert (arrays["origin"] == 2).sum() > 0
    assert (arrays["deviation"][arrays["origin"] == 0] == 0).all()


# --- as a whole ------------------------------------------------------------------------------


@pytest.mark.slow
def test_shift_and_scale_change_nothing():
    vertices, faces = box_mesh()
    broken = np.delete(faces, [0, 16], axis=0)
    _, reference, _, _ = fix(vertices, broken)
    for scale, shift in ((1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)):
        fixed, fixed_faces, _, _ = fix(vertices * scale + shift, broken)
        assert_valid(fixed, fixed_faces)
        assert np.array_equal(fixed_faces, reference)


@pytest.mark.slow
def test_the_same_bytes_again():
    two = copies(ball(3), ball(3, centre=(1.0, 0.1, 0)))
    first, again = (fix(*two) for _ in range(2))
    assert first[0].tobytes() == again[0].tobytes()
    assert first[1].tobytes() == again[1].tobytes()
    assert first[2] == again[2]


def test_build_closed_form_and_shipped_mesh():
    arrays, attributes = build(MeshTask(source="analytic:torus", sha256=None, seed=0), None, print)
    assert attributes["shape"] == "torus"
    assert attributes["frame"]["scale"] == pytest.approx(1.8 / 2.8)
    assert attributes["deviation"]["to_result"]["max"] < 1e-3
    assert arrays["faces"].dtype == np.int32
    task = MeshTask(source="pymeshlab:bunny10k_textured.obj", sha256=None, seed=1)
    arrays, attributes = build(task, None, print)
    assert [r["operation"] for r in attributes["rungs"] if r["kept"]] == ["fill"]
    assert len(attributes["before"]["holes"]) == 5
    assert attributes["deviation"]["to_result"]["max"] == 0  # what was there has stayed
    assert_valid(arrays["vertices"], arrays["faces"])


# --- real meshes -----------------------------------------------------------------------------


def real(path):
    return read_mesh(path.name, path)[0][:2]


@pytest.mark.slow
def test_sound_real_meshes_pass_bit_identical(meshes):
    """After the exact weld that STL needs; `tooth_2comp` is nested and handled as documented."""
    passed = 0
    for path in sorted(meshes.glob("watertight/*")):
        vertices, faces = real(path)
        fixed, fixed_faces, record, kept = fix(vertices, faces)
        assert_valid(fixed, fixed_faces, points=2000, crossings=False)
        if path.name.startswith("tooth"):
            assert "orient" in kept
            assert record["after"]["cavities"] == 1
            continue
        assert set(kept) <= {"clean"}
        assert np.array_equal(fixed[fixed_faces], vertices[faces])
        assert record["deviation"]["untouched"] == 1
        passed += 1
    assert passed == 8


@pytest.mark.slow
def test_the_original_bunny_is_closed_and_untouched(meshes):
    vertices, faces = real(meshes / "stanford/bunny_35947v_69451f_binary.ply")
    fixed, fixed_faces, record, kept = fix(vertices, faces)
    assert kept == ["clean", "fill"]
    assert_valid(fixed, fixed_faces, points=2000)
    assert record["deviation"]["to_result"]["max"] == 0
    assert record["deviation"]["untouched"] == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "backslash_ngons_wallhole.obj",
        "cracked_angleblock_704f.stl",
        "nonmanifold_vertex_cow_5804f.obj",
        "overlap_boolean_scene_3936f.glb",
        "slivers_offset_4418f.obj",
    ],
)
def test_broken_real_meshes_end_valid(meshes, name):
    fixed, fixed_faces, record, _ = fix(*real(meshes / "broken" / name))
    assert_valid(fixed, fixed_faces)
    assert record["deviation"]["to_source"]["p99"] < 1e-6 * record["after"]["diagonal"]


def test_what_has_no_geometry_is_refused(meshes):
    for name in ("empty.stl", "infinite_coordinates_box.glb"):
        with pytest.raises(PandisError, match=name):
            real(meshes / "broken" / name)


def test_tools_run_on_one_thread_whatever_their_parent_does(monkeypatch):
    """The exact union orders its faces by the number of libigl's threads."""
    started, run = [], subprocess.run

    def watched(command, **options):
        started.append(options["env"])
        return run(command, **options)

    monkeypatch.setenv("IGL_NUM_THREADS", "2")
    monkeypatch.setattr(subprocess, "run", watched)
    tools.call("clean", *box_mesh(), seconds=60, memory_gb=3)
    names = ("IGL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    assert [started[0][name] for name in names] == ["1", "1", "1"]


def triangulations(start, end):
    """All triangulations of the corners start to end of a polygon."""
    if end - start < 2:
        return [[]]
    return [
        [(start, middle, end), *left, *right]
        for middle in range(start + 1, end)
        for left in triangulations(start, middle)
        for right in triangulations(middle, end)
    ]


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7])
def test_a_hole_is_closed_with_the_least_area_of_all_triangulations(n, monkeypatch):
    """The same triangles are chosen however many are compared at once, by folds, too."""
    rng = np.random.default_rng(n)
    for _ in range(10):
        points = rng.normal(size=(n, 3))
        barred = {(int(k), int(k) + 2) for k in rng.integers(n - 2, size=n // 4)} - {(0, n - 1)}
        areas = []
        for triangles in triangulations(0, n - 1):
            if not barred & {pair for a, b, c in triangles for pair in ((a, b), (b, c), (a, c))}:
                a, b, c = points[np.array(triangles).T]
                areas.append(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

        def chosen(weight, points=points, barred=barred):
            def forbidden(start, end):
                return (int(start), int(end)) in barred

            return holes.least_cost_triangles(points, weight, forbidden=forbidden)

        together = {weight: chosen(weight) for weight in ("area", "fold")}
        with monkeypatch.context() as patch:
            patch.setattr(holes, "_AT_ONCE", 1)
            for weight, triangles in together.items():
                assert np.array_equal(chosen(weight), triangles)
        a, b, c = points[together["area"].T]
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        assert area == pytest.approx(min(areas, default=0.0), rel=1e-9)

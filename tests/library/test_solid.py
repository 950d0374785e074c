"""Solids of meshes that no exact repair closes: what is solid, and that the surface is sound."""

import os
import subprocess
import sys
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np
import pytest
import trimesh

import pandis
from pandis.engine.faces import crossings
from pandis.engine.solid import FINENESS, library, merged, reopened, rims
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.processes import CpuTime, CpuTimeError
from pandis.pipeline.mesh.solid import SolidRules, make_solid, rules_of, simplification
from pandis.pipeline.mesh.solid.source import source_of
from pandis.pipeline.mesh.tree import MeshTree
from pandis.pipeline.run.ask.options import MeshOptions
from support import octahedron

finishing = sys.modules["pandis.pipeline.mesh.solid.finish"]  # its package has a function finish
CELLS = 64
EDGES = [(low, axis) for axis in range(3) for low in range(8) if not low >> axis & 1]


def solid_of(mesh, **rules):
    """Return the solid of a trimesh object or of (vertices, faces), once diagnosed as valid."""
    vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "faces") else mesh
    vertices, faces = np.array(vertices, float), np.array(faces, np.int64)
    solid = make_solid(
        vertices, faces, SolidRules(**{"cells": CELLS} | rules), log=lambda text: None
    )
    assert diagnose(solid.vertices, solid.faces).faults() == "none"
    return solid


def inside(solid, *points):
    return (MeshTree(solid.vertices, solid.faces).windings(np.array(points, float)) > 0.5).tolist()


def joined(*meshes):
    return trimesh.util.concatenate(meshes)


def without(mesh, which):
    """Return a mesh without some faces."""
    mesh = mesh.copy()
    mesh.update_faces(~np.isin(np.arange(len(mesh.faces)), which))
    return mesh


def open_box(width=1.0, gap=None):
    """Return a box without its top, or with a slit of a width in its top."""
    box = trimesh.creation.box((width, 1, 1))
    top = np.flatnonzero((box.triangles[:, :, 2] > 0.49).all(axis=1))
    box = without(box, top)
    if gap is None:
        return box
    lids = []
    for side in (-1, 1):
        corners = np.array([[side * gap / 2, -0.5], [side * width / 2, -0.5],
                            [side * width / 2, 0.5], [side * gap / 2, 0.5]])  # fmt: skip
        corners = np.column_stack([corners, np.full(4, 0.5)])
        faces = np.array([[0, 1, 2], [0, 2, 3]])[:, ::side]
        lids.append(trimesh.Trimesh(corners, faces, process=False))
    return joined(box, *lids)


# --- the surface in one cell -------------------------------------------------------------


def loops_of(solid):
    out = np.zeros(64, np.int32)
    library().solid_loops(solid, out.ctypes.data)
    values, loops = out[1:].tolist(), []
    for _ in range(out[0]):
        loops.append(values[1 : 1 + values[0]])
        values = values[1 + values[0] :]
    return loops


def fans_of(solid):
    return [
        (loop[0], loop[k], loop[k + 1]) for loop in loops_of(solid) for k in range(1, len(loop) - 1)
    ]


def crosses(p, q, a, b, c):
    """Whether segments (n) cross triangles (n), not only touch them."""
    d, e1, e2 = q - p, b - a, c - a
    h = np.cross(d, e2)
    det = (e1 * h).sum(-1)
    with np.errstate(all="ignore"):
        s = p - a
        u = (s * h).sum(-1) / det
        g = np.cross(s, e1)
        v, t = (d * g).sum(-1) / det, (e2 * g).sum(-1) / det
    e = 1e-9
    return (
        (np.abs(det) > 1e-12) & (u > e) & (v > e) & (u + v < 1 - e) & (t > e) & (t < 1 - e)
    ).any()


def test_fans_of_one_cell_never_cross_wherever_their_corners_lie():
    rng = np.random.default_rng(0)
    corner = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], float)
    along = rng.random((1500, 12))
    kind = rng.random((1500, 12))
    along = np.where(kind < 0.25, along * 1e-2, np.where(kind < 0.5, 1 - along * 1e-2, along))
    place = np.array([corner[low] + along[:, e, None] * np.eye(3)[axis]
                      for e, (low, axis) in enumerate(EDGES)])  # fmt: skip
    for solid in range(256):
        for one, other in combinations(fans_of(solid), 2):
            for first, second in ((one, other), (other, one)):
                a, b, c = (place[e] for e in second)
                for k in range(3):
                    p, q = first[k], first[(k + 1) % 3]
                    if p not in second and q not in second:
                        assert not crosses(place[p], place[q], a, b, c), solid


def test_neighbouring_cells_agree_on_their_common_side():
    """Each segment on a side of a cell is one of the next cell's, in the other direction."""
    for axis in range(3):
        bit, sides = 1 << axis, {}
        for solid in range(256):
            for high in (0, 1):
                on_side = [e for e, (low, along) in enumerate(EDGES)
                           if along != axis and (low >> axis & 1) == high]  # fmt: skip
                name = {e: on_side.index(e) for e in on_side}
                state = tuple(solid >> c & 1 for c in range(8) if (c >> axis & 1) == high)
                segments = set()
                for loop in loops_of(solid):
                    for one, other in zip(loop, loop[1:] + loop[:1], strict=True):
                        if one in name and other in name:
                            segments.add((name[one], name[other]))
                if high:
                    segments = {(b, a) for a, b in segments}
                assert sides.setdefault(state, segments) == segments, (solid, bit)


# --- what is solid -------------------------------------------------------------------------


def test_a_box_stays_a_box_to_the_last_bit_of_volume():
    solid = solid_of(trimesh.creation.box((3, 2, 1)))
    assert len(solid.faces) < 100
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(6, abs=1e-3)
    assert (solid.facts.kinds, solid.facts.invented, solid.facts.sheets) == ({"closed": 1}, 0, 0)


@pytest.mark.parametrize("turned", ["out", "in", "mixed"])
def test_orientation_does_not_matter(turned):
    sphere = trimesh.creation.icosphere(subdivisions=3)
    faces = np.array(sphere.faces)
    flip = {"out": [], "in": slice(None), "mixed": slice(None, None, 3)}[turned]
    faces[flip] = faces[flip][:, ::-1]
    solid = solid_of((sphere.vertices, faces))
    volume = diagnose(solid.vertices, solid.faces).volume
    assert volume == pytest.approx(sphere.volume, rel=0.01)


def test_loose_triangles_with_cracks_are_one_solid():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    corners = np.array(sphere.triangles)
    corners += 1e-4 * np.random.default_rng(0).standard_normal(corners.shape)
    solid = solid_of((corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3)))
    assert inside(solid, (0, 0, 0), (0.9, 0, 0), (1.1, 0, 0)) == [True, True, False]


def test_a_hole_is_closed_and_reported():
    box = open_box()
    solid = solid_of(box, share=0.5)
    assert inside(solid, (0, 0, 0)) == [True]
    (width,) = solid.facts.caps
    assert width == pytest.approx(2**0.5)
    assert solid.facts.invented == pytest.approx(1 / 6, abs=0.02)
    assert solid.facts.kinds == {"filled": 1}


def test_a_room_with_too_large_a_share_of_invented_walls_stays_a_shell():
    solid = solid_of(open_box(), share=0.1)
    assert inside(solid, (0, 0, 0)) == [False]
    assert (solid.facts.opened, solid.facts.kinds) == (1, {"sheet": 1})
    assert (solid.facts.caps, solid.facts.invented) == ([], 0)  # the hole stays open
    wall = solid.facts.thickness
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(5 * wall, rel=0.35)


def test_a_slit_between_open_edges_is_a_door_up_to_the_stated_width():
    box = open_box(gap=0.1)
    diagonal = 3**0.5
    shut = solid_of(box, widest_cap=0, widest_door=0.12 / diagonal)
    assert inside(shut, (0, 0, 0)) == [True]
    assert shut.facts.doors[0] == pytest.approx(0.1, abs=2 * shut.facts.cell)
    ajar = solid_of(box, widest_cap=0, widest_door=0.05 / diagonal)
    assert inside(ajar, (0, 0, 0)) == [False]


def blocks(filled):
    """Return the surface of cubes: a closed mesh, its vertices merged."""
    corner = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)])
    filled, quads = np.pad(filled, 1), []
    for axis in range(3):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        for way in (-1, 1):
            ring = np.array([0, u, u | v, v])[::way] | (way > 0) << axis
            shown = np.argwhere(filled & ~np.roll(filled, -way, axis))
            quads.append(shown[:, None] + corner[ring])
    quads = np.concatenate(quads).reshape(-1, 3)
    vertices, index = np.unique(quads, axis=0, return_inverse=True)
    quads = index.reshape(-1, 4)
    return vertices / filled.shape[0], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def test_a_window_of_a_closed_mesh_is_never_shut():
    """A thick-walled box with a narrow window: its room is air, however narrow the window."""
    filled = np.ones((16, 16, 16), bool)
    filled[2:-2, 2:-2, 2:-2] = False
    whole = solid_of(blocks(filled))
    filled[7, 7, -2:] = False
    solid = solid_of(blocks(filled))
    middle, wall = (0.5, 0.5, 0.5), (1.5 / 18, 0.5, 0.5)
    assert inside(solid, middle, wall) == [False, True]
    assert (inside(whole, middle, wall), whole.facts.cavities) == ([False, True], 1)


def test_nested_shells_are_cavities_only_if_their_orientation_says_so():
    outer = trimesh.creation.icosphere(subdivisions=3)
    inner = outer.copy().apply_scale(0.5)
    turned = inner.copy()
    turned.invert()
    assert inside(solid_of(joined(outer, inner)), (0, 0, 0)) == [True]
    hollow = solid_of(joined(outer, turned))
    assert (inside(hollow, (0, 0, 0), (0.7, 0, 0)), hollow.facts.cavities) == ([False, True], 1)
    assert inside(solid_of(joined(outer, turned), keep_cavities=False), (0, 0, 0)) == [True]


def test_a_component_within_another_is_buried_and_said_to_be():
    outer, inner = trimesh.creation.box((1, 1, 1)), trimesh.creation.icosphere(radius=0.3)
    solid = solid_of(joined(outer, inner))
    assert (len(solid.faces) < 100, solid.facts.kinds) == (True, {"solid": 1})


def tub(floor=True):
    """Return a tall box without top and bottom; half-way up is a floor that faces up."""
    box = trimesh.creation.box((1, 1, 2))
    box = without(box, np.flatnonzero(np.abs(box.face_normals[:, 2]) > 0.9))
    corners = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    return joined(box, sheet) if floor else box


@pytest.mark.parametrize("seed", range(4))
def test_of_two_rooms_at_a_wall_that_is_seen_one_stays_open(seed):
    """What is above the floor of a tub is air and what is below is solid, however it lies."""
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))
    places = np.array([[0, 0, 0.5], [0, 0, -0.5]]) @ turn[:3, :3].T
    solid = solid_of(tub().apply_transform(turn))
    assert inside(solid, *places) == [False, True]
    assert len(solid.facts.caps) == 1
    assert inside(solid_of(tub(floor=False).apply_transform(turn)), *places) == [True, True]


def test_an_open_room_is_solid_whatever_passes_through_it():
    """A ball without its bottom, through which a rod passes that can be seen from below."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    ball = without(ball, np.flatnonzero((ball.triangles[:, :, 2] < -0.7).all(axis=1)))
    rod = trimesh.creation.cylinder(radius=0.25, height=3)
    solid = solid_of(joined(ball, rod))
    assert inside(solid, (0, 0, 0), (0.6, 0, 0), (0, 0, 1.2), (0, 0, -1.2)) == [True] * 4


def test_back_to_back_faces_are_a_wall_and_not_a_solid():
    box = open_box()
    cup = trimesh.Trimesh(box.vertices, np.concatenate([box.faces, box.faces[:, ::-1]]),
                          process=False)  # fmt: skip
    solid = solid_of(cup)
    assert (inside(solid, (0, 0, 0)), solid.facts.kinds) == ([False], {"sheet": 1})


def test_a_closed_part_drawn_from_both_sides_is_solid():
    box = trimesh.creation.box((1, 1, 1))
    both = np.concatenate([box.faces, box.faces[:, ::-1]])
    solid = solid_of((box.vertices, both))
    assert (inside(solid, (0, 0, 0)), solid.facts.cavities) == ([True], 0)


def test_a_curved_sheet_has_nothing_beside_it():
    """The fan over its rim runs close to it: what lies between them is no solid."""
    x, y = np.meshgrid(np.linspace(-1, 1, 33), np.linspace(-1, 1, 33), indexing="ij")
    vertices = np.stack([x, y, 0.3 * x * y], axis=-1).reshape(-1, 3)
    a = np.arange(33 * 32).reshape(32, 33)[:, :-1].reshape(-1)
    faces = np.concatenate([np.stack([a, a + 33, a + 34], 1), np.stack([a, a + 34, a + 1], 1)])
    solid = solid_of((vertices, faces))
    height = np.abs(solid.vertices[:, 2] - 0.3 * solid.vertices[:, 0] * solid.vertices[:, 1])
    assert height.max() < 0.6 * solid.facts.cell
    assert solid.facts.kinds == {"sheet": 1}


def test_crossing_parts_become_one_surface():
    boxes = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.5, 0.5, 2))]
    solid = solid_of(joined(*boxes))
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(1 + 0.25, rel=0.01)


def test_a_sheet_gets_a_thickness_there_alone():
    plate = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    solid = solid_of(plate, thickness=0.5)
    thickness = 0.5 * solid.facts.cell
    assert solid.facts.thickness == pytest.approx(thickness)
    assert np.abs(solid.vertices[:, 2]).max() == pytest.approx(thickness / 2, rel=0.05)
    assert solid.facts.kinds == {"sheet": 1}
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(thickness, rel=0.1)
    assert np.ptp(solid.vertices[:, 0]) == pytest.approx(1, abs=0.02)
    ball = trimesh.creation.icosphere(subdivisions=3).apply_translation((3, 0, 0))
    both = solid_of(joined(plate, ball))
    assert both.facts.kinds == {"closed": 1, "sheet": 1}


def test_a_closed_solid_thinner_than_a_cell_is_as_thick_as_it_is():
    plate = trimesh.creation.box((1, 1, 0.4 / CELLS))
    solid = solid_of(plate)
    assert np.ptp(solid.vertices[:, 2]) == pytest.approx(0.4 / CELLS, rel=0.1)
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(0.4 / CELLS, rel=0.1)


def test_the_outline_of_a_thin_disc_stays():
    """Its rim has little area: an error that area weights would let it go."""
    disc = trimesh.creation.cylinder(0.5, 1.0 / CELLS, sections=64)
    solid = solid_of(disc)
    radius = np.hypot(solid.vertices[:, 0], solid.vertices[:, 1])
    rim = np.linalg.norm(solid.vertices[solid.faces].mean(axis=1)[:, :2], axis=1)
    assert radius.max() == pytest.approx(0.5, abs=0.1 * solid.facts.cell)
    assert diagnose(solid.vertices, solid.faces).volume == pytest.approx(disc.volume, rel=0.03)
    assert rim.max() > 0.48


def test_a_face_through_a_node_of_the_lattice_does_not_leak():
    """Rounding puts the node on different sides of the face along different axes."""
    whole = np.array(trimesh.creation.box((1, 1, 1)).apply_translation((0.5, 0.5, 0.5)).vertices)
    frame = source_of(whole, np.array(trimesh.creation.box((1, 1, 1)).faces), CELLS).frame
    for k in (20, 25, 31):
        a = 1 - (k * frame.cell + frame.origin[2] - frame.origin[0])
        outline = np.array([(0, 0), (1, 0), (1, 1), (a, 1), (0, 1 - a)])
        ring = [np.column_stack([outline[:, 0], np.full(5, y), outline[:, 1]]) for y in (0, 1)]
        sides = [(i, (i + 1) % 5) for i in range(5)]
        faces = [[i, j, j + 5] for i, j in sides] + [[i, j + 5, i + 5] for i, j in sides]
        faces += [[0, i + 1, i] for i in range(1, 4)] + [[5, 5 + i, 6 + i] for i in range(1, 4)]
        solid = solid_of((np.concatenate(ring), faces))
        assert inside(solid, (0.6, 0.5, 0.3)) == [True]


def test_a_mesh_too_far_away_and_one_of_extreme_size():
    box = trimesh.creation.box((3, 3, 3))
    with pytest.raises(pandis.PandisError, match="too far from the origin"):
        solid_of((box.vertices + 5.7e14, box.faces))
    opened = open_box()
    for scale in (1e-100, 1e100):
        with np.errstate(over="ignore"):
            vertices, faces = opened.vertices * scale, np.array(opened.faces)
            solid = make_solid(vertices, faces, SolidRules(cells=64), log=lambda text: None)
        assert len(solid.faces) < 2000


def test_two_sheets_in_one_cell_are_still_one_sound_surface():
    plate = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    near = plate.copy().apply_translation((0, 0, 0.5 / CELLS))
    slanted = plate.copy().apply_transform(trimesh.transformations.rotation_matrix(0.02, (1, 0, 0)))
    solid_of(joined(plate, near))
    solid_of(joined(plate, slanted))


def test_a_rim_that_is_not_planar_is_closed():
    sphere = trimesh.creation.icosphere(subdivisions=4)
    middle = sphere.triangles_center
    saddle = middle[:, 2] > 0.75 + 0.3 * np.sin(2 * np.arctan2(middle[:, 1], middle[:, 0]))
    solid = solid_of(without(sphere, np.flatnonzero(saddle)), share=0.5)
    assert inside(solid, (0, 0, 0), (0, 0, -0.9)) == [True, True]
    assert solid.facts.kinds == {"filled": 1}


def test_debris_is_dropped_and_named():
    ball, dust = trimesh.creation.icosphere(), trimesh.creation.icosphere(radius=0.1)
    mesh = joined(ball, dust.apply_translation((1.5, 0, 0)))
    assert len(solid_of(mesh).facts.components) == 2
    solid = solid_of(mesh, debris=0.01)
    assert (len(solid.facts.components), len(solid.facts.dropped)) == (1, 1)
    assert diagnose(solid.vertices, solid.faces).components == 1


@pytest.mark.parametrize("seed", range(6))
def test_any_triangles_have_a_sound_surface(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    corners = rng.standard_normal((count, 3, 3)) * rng.choice([1, 0.1], (count, 1, 1))
    corners += rng.standard_normal((count, 1, 3))
    if seed % 2:
        sphere = trimesh.creation.icosphere(subdivisions=3)
        corners = np.concatenate([corners, sphere.triangles[rng.random(1280) < 0.8]])
    solid_of((corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)))


def test_simplification_keeps_the_surface_within_its_tolerance():
    torus = trimesh.creation.torus(1, 0.4, major_sections=128, minor_sections=64)
    fine = solid_of(torus, tolerance=0.0)
    coarse = solid_of(torus)
    assert len(coarse.faces) < 0.5 * len(fine.faces)
    # the distance of both from the torus itself, in cells
    for solid, bound in ((fine, 0.1), (coarse, 0.1)):
        v = solid.vertices
        off = np.hypot(np.hypot(v[:, 0], v[:, 1]) - 1, v[:, 2]) - 0.4
        assert np.abs(off).max() < bound * solid.facts.cell
        middle = v[solid.faces].mean(axis=1)
        off = np.hypot(np.hypot(middle[:, 0], middle[:, 1]) - 1, middle[:, 2]) - 0.4
        assert np.abs(off).max() < 0.12 * solid.facts.cell


def test_locked_vertices_stay_and_odd_edges_are_named():
    box = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
    faces, locked = np.array(box.faces), np.zeros(len(box.vertices), bool)
    locked[:60] = True
    into = merged(box.vertices, faces, locked=locked, tolerance=0.01)
    assert (into[:60] == np.arange(60)).all()
    assert len(set(into.tolist())) == 60  # these stand for all others
    assert (into[into] == into).all()
    into = merged(box.vertices, faces[1:], locked=locked, tolerance=0.01)
    assert set(np.flatnonzero(into < 0)) == set(faces[0])
    ball = trimesh.creation.icosphere(subdivisions=1)
    other = np.where(ball.faces == 0, 0, ball.faces + len(ball.vertices) - 1)
    both = np.concatenate([ball.vertices, ball.vertices[1:] + 5])
    pinched = np.concatenate([ball.faces, other])
    into = merged(both, pinched, locked=np.zeros(len(both), bool), tolerance=0.01)
    assert np.flatnonzero(into < 0).tolist() == [0]
    twice = np.concatenate([faces, faces[5:6]])
    into = merged(box.vertices, twice, locked=locked, tolerance=0.01)
    assert set(np.flatnonzero(into < 0)) == set(faces[5])


@pytest.mark.parametrize("chosen", [1, 5, 40])
def test_vertices_are_taken_apart_where_they_are_chosen_and_leave_sound_faces(chosen):
    """Around them all stand for themselves; elsewhere nothing changes; no face turns over."""
    torus = trimesh.creation.torus(1, 0.4, 192, 96)
    places, faces = np.array(torus.vertices) * 10, np.array(torus.faces, np.int32)
    nothing, tolerance = np.zeros(len(places), bool), 0.05
    into = merged(places, faces, locked=nothing, tolerance=tolerance)
    rng = np.random.default_rng(chosen)
    some = np.isin(np.arange(len(places)), rng.choice(len(places), chosen, replace=False))
    now, apart = reopened(places, faces, into=into, chosen=some, tolerance=tolerance)
    assert apart[some].all()
    assert (now[apart] == np.flatnonzero(apart)).all()
    assert (now[~apart] == into[~apart]).all()
    assert not set(into[apart]) & set(into[~apart])  # whole groups
    assert apart.mean() < 0.2
    corners, before = places[now[faces]], places[faces]
    normal, was = (np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (corners, before))
    border = np.isin(apart[faces].sum(axis=1), (1, 2)) & (normal != 0).any(axis=1)
    assert border.any()
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(was, axis=1)
    assert (np.einsum("ij,ij->i", normal, was) >= 0.2 * size - 1e-12)[border].all()
    unit = was / np.linalg.norm(was, axis=1, keepdims=True)
    off = np.einsum("ijk,ik->ij", corners - before[:, :1], unit)
    assert np.abs(off[border]).max() < 2 * tolerance + 1e-12
    twice = now[merged(places, now[faces][(normal != 0).any(axis=1)], locked=~apart,
                       tolerance=tolerance)[now]]  # fmt: skip
    left = twice[faces]
    left = left[(left != np.roll(left, 1, axis=1)).all(axis=1)]
    assert trimesh.Trimesh(places, left, process=False).is_watertight


def crossing_triangles(count, seed):
    """Return loose triangles, most of which cross."""
    vertices = np.random.default_rng(seed).random((3 * count, 3))
    return vertices, np.arange(3 * count).reshape(-1, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed", "apart_twice"), [(30, 3, True), (40, 7, True),
                                                            (40, 5, False)])  # fmt: skip
def test_all_that_changed_is_judged_again(count, seed, apart_twice, monkeypatch):
    """Each face that is new, or has another place, since the attempt before; until none is bad."""
    judge, take_apart, log = simplification._bad_faces, simplification.reopened, []
    before = {}

    def checked(faces, chosen, *, places, vertices):
        now = {tuple(face): vertices[face].tobytes() for face in faces.tolist()}
        new = [now[face] != before.get(face) for face in now]
        assert len(now) == len(faces)
        assert chosen[new].all()
        before.clear()
        before.update(now)
        bad = judge(faces, chosen, places=places, vertices=vertices)
        log.append(len(bad))
        return bad

    def noted(*mesh, **options):
        log.append("apart")
        return take_apart(*mesh, **options)

    monkeypatch.setattr(simplification, "_bad_faces", checked)
    monkeypatch.setattr(simplification, "reopened", noted)
    solid = solid_of(crossing_triangles(count, seed))
    assert log[-1] == 0
    assert 3 <= sum(entry != "apart" for entry in log) < 10
    assert ("apart", "apart") in [*pairwise(log)] or not apart_twice
    fine = solid_of(crossing_triangles(count, seed), tolerance=0.0)
    assert len(solid.faces) < 0.6 * len(fine.faces)


@pytest.mark.parametrize("seed", range(6))
def test_no_faces_cross_where_sides_of_sheets_are_placed(seed, monkeypatch):
    seen, simplify = [], finishing.simplify

    def noted(boundary, places, *others, **options):
        seen.append((places.copy(), boundary.faces))
        return simplify(boundary, places, *others, **options)

    monkeypatch.setattr(finishing, "simplify", noted)
    solid_of(crossing_triangles(30, seed))
    ((places, faces),) = seen
    assert not len(crossings(places, faces))


def test_where_simplified_faces_cross_only_their_surroundings_are_made_anew(monkeypatch):
    torus = trimesh.creation.torus(1, 0.4, 96, 48)
    before, judge, calls = solid_of(torus), simplification._bad_faces, []

    def refuse_one(faces, chosen, *, places, vertices):
        calls.append(chosen.mean())
        if len(calls) > 1:
            return judge(faces, chosen, places=places, vertices=vertices)
        return np.flatnonzero(vertices[faces][:, 0, 0] > vertices[:, 0].max() - 0.01)[:1]

    monkeypatch.setattr(simplification, "_bad_faces", refuse_one)
    after = solid_of(torus)
    assert calls[0] == 1
    assert calls[1] < 0.2
    faces = [{tuple(map(tuple, face)) for face in s.vertices[s.faces]} for s in (before, after)]
    changed = np.array(list(faces[0] ^ faces[1]))
    assert len(changed)
    assert len(faces[1] - faces[0]) < 0.1 * len(faces[0])
    assert changed[..., 0].min() > 0.5  # on the side of the face that was refused


def test_vertices_are_placed_without_rounding():
    """After rounding, two faces in one plane of the lattice could cross."""
    sphere = trimesh.creation.icosphere().apply_scale(1.2345).apply_translation((3, -5, 7))
    frame = source_of(np.array(sphere.vertices), np.array(sphere.faces), 200).frame
    whole = np.random.default_rng(0).integers(0, 200 * FINENESS, (200, 3))
    for row, placed in zip(whole, frame.to_mesh(whole / FINENESS), strict=True):
        for k in range(3):
            exact = Fraction(int(row[k]), FINENESS) * Fraction(frame.cell)
            assert exact + Fraction(frame.origin[k]) == Fraction(placed[k])


def test_rims_are_closed_loops_that_use_each_edge_once():
    #     a triangle and a square that share vertex 2, and a way that ends
    edges = [(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 5), (5, 2), (6, 7)]
    loops = rims(np.array(edges), 8)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [[0, 1, 2], [2, 3, 4, 5]]


@pytest.mark.slow
def test_the_same_bytes_whatever_the_number_of_threads():
    code = """if True:
        import hashlib, sys, numpy as np, trimesh
        from pandis.pipeline.mesh.solid import SolidRules, make_solid
        mesh = trimesh.creation.icosphere(subdivisions=4)
        keep = np.random.default_rng(0).random(len(mesh.faces)) < 0.95
        solid = make_solid(np.array(mesh.vertices), np.array(mesh.faces)[keep],
                           SolidRules(cells=96), log=lambda text: None)
        print(hashlib.sha256(solid.vertices.tobytes() + solid.faces.tobytes()).hexdigest())
    """
    digests = set()
    for threads in ("1", "2", "3"):
        environment = os.environ | {"IGL_NUM_THREADS": threads, "OMP_NUM_THREADS": threads,
                                    "PYTHONPATH": os.pathsep.join(sys.path)}  # fmt: skip
        done = subprocess.run([sys.executable, "-c", code], env=environment, text=True,
                              capture_output=True, check=True)  # fmt: skip
        digests.add(done.stdout.strip())
    assert len(digests) == 1


# --- as a rung of repair ---------------------------------------------------------------------


def quiet(mesh, **options):
    return pandis.repair((mesh.vertices, mesh.faces), **options)


@pytest.mark.slow
def test_a_refusal_recommends_a_solid_that_works():
    box = open_box()
    with pytest.raises(pandis.RepairError, match=r"`mesh: \{solid: always\}`") as refused:
        quiet(box, small_hole=0.1)
    assert refused.value.option == {"solid": "always"}
    closed = quiet(box, small_hole=0.1, **refused.value.option)
    assert (closed.rungs[-1], closed.record.solid) == ("fill", None)  # exact, so it comes first
    mesh = quiet(box, small_hole=0.1, solid_share=0.1, **refused.value.option)
    assert mesh.rungs == ["solid"]  # it is made of the mesh as read
    assert mesh.record.solid.why.startswith("caps are 17 % of the surface")
    assert (mesh.record.solid.opened, mesh.record.solid.kinds) == (1, {"sheet": 1})
    assert mesh.record.after["valid"]
    capped = quiet(box, solid_share=0.1, open="cap", **refused.value.option)
    assert capped.rungs[-1] == "fill"


@pytest.mark.slow
def test_pieces_that_an_exact_repair_would_leave_out_are_part_of_a_solid():
    box = trimesh.creation.box((1, 1, 1))
    sheet = trimesh.Trimesh([[2, 0, 0], [3, 0, 0], [3, 1, 0]], [[0, 1, 2]])
    mesh = quiet(joined(box, sheet), solid="always")
    assert mesh.record.solid.kinds == {"closed": 1, "sheet": 1}


def test_an_exact_repair_comes_before_a_solid():
    box = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
    mesh = quiet(without(box, [5]), solid="always")
    assert (mesh.rungs, mesh.record.solid) == (["fill"], None)
    whole = quiet(box, solid="always")
    assert whole.unchanged
    assert np.array_equal(whole.vertices, box.vertices)


@pytest.mark.slow
def test_exact_repairs_have_a_budget_of_time():
    box = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
    mesh = quiet(without(box, [5]), solid="always", solid_after=0)
    assert mesh.rungs == ["solid"]
    assert {rung.reason for rung in mesh.record.rungs[:-1]} == {
        "no time is left (mesh.solid_after)"
    }


@pytest.mark.slow
def test_the_faces_that_close_a_solid_are_its_caps():
    """They are the faces over the missing top of a box, and no others."""
    mesh = quiet(open_box(), solid="always", solid_after=0)
    assert mesh.rungs == ["solid"]
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                          axis=1) / 2  # fmt: skip
    cap = mesh.origin == mesh.ORIGINS.index("cap of a hole")
    assert np.abs(corners[cap, :, 2] - 0.5).max() < 2 * mesh.record.solid.cell
    assert area[cap].sum() == pytest.approx(1, abs=0.05)


@pytest.mark.slow
def test_an_exact_repair_that_takes_too_long_is_stopped():
    ball = trimesh.creation.icosphere(subdivisions=6)
    both = joined(ball, ball.copy().apply_translation((0.5, 0.1, 0.2)))
    with pytest.raises(CpuTimeError, match="took longer than 0 CPU s"):
        tools.call("union", both.vertices, both.faces, seconds=60, memory_gb=3, cpu=CpuTime(0.0))


def test_the_fineness_follows_the_error_that_is_asked_for():
    vertices = np.array([[0, 0, 0], [10.0, 0, 0], [0, 5, 0]])

    def cells(error, **options):
        return rules_of(MeshOptions(solid_error=error, **options), vertices).cells

    assert cells("512 cells") == 512
    assert cells("0.05") == cells("0.05 mm", unit="mm") == cells("0.005 cm", unit="mm") == 108
    assert cells("0.5 %") == 98  # of the diagonal
    assert cells("5 %") == 64  # as coarse as there is
    faults = {"0.05 mm": "the unit of the mesh is unknown", "256": "more than 1/16 of the mesh's",
              "0.0001": "takes 50008 cells"}  # fmt: skip
    for error, why in faults.items():
        with pytest.raises(pandis.PandisError, match=why):
            cells(error)


@pytest.mark.parametrize("size", [1.0, 1e-3])
@pytest.mark.parametrize(("height", "flat"), [(1.0, False), (0.6, False), (1e-9, True)])
def test_a_component_so_flat_that_rounding_could_turn_it_goes_back(height, flat, size):
    """A component that was as small in the lattice stays as it was."""
    vertices, faces = octahedron()
    vertices = vertices * size
    for turned in (faces, faces[:, ::-1]):  # a solid and a cavity
        volume = trimesh.Trimesh(vertices, turned, process=False).volume
        part, places = np.zeros(len(vertices), int), vertices * [1, 1, height]
        turns = simplification._turned(part, places, turned, volume=np.array([volume]))
        assert (turns == flat).all()

"""What goes wrong in public reports, as small meshes: each right, or refused with a remedy.

A remedy that a refusal names is tried here.
"""

import re

import numpy as np
import pytest
import trimesh

from pandis.base.errors import PandisError
from pandis.pipeline.mesh.repair import repair
from pandis.pipeline.run.ask.options import MeshOptions
from validity import assert_valid, volume


def box(low=(0, 0, 0), size=(1, 1, 1)):
    made = trimesh.creation.box(size)
    return made.vertices + np.array(size) / 2 + low, np.asarray(made.faces, np.int64)


def joined(*parts):
    vertices, faces, offset = [], [], 0
    for v, f in parts:
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def mended(mesh, **options):
    said = []
    arrays, record = repair(*mesh, MeshOptions(**options), seed=0, log=said.append)
    assert_valid(arrays["vertices"], arrays["faces"], points=2000)
    return arrays["vertices"], arrays["faces"].astype(np.int64), record, "\n".join(said)


def refusal(mesh, **options):
    with pytest.raises(PandisError) as caught:
        repair(*mesh, MeshOptions(**options), seed=0, log=lambda text: None)
    return str(caught.value)


def remedied(mesh):
    """Refuse a mesh, then do what the refusal says first."""
    said = refusal(mesh)
    options = re.search(r"`mesh: \{(\w+): (\w+)\}`", said)
    return said, mended(mesh, **{options[1]: options[2]})


def shared_wall():
    """Two unit boxes side by side, their common wall once."""
    corners = np.array([[x, y, z] for x in (0, 1, 2) for y in (0, 1) for z in (0, 1)], float)

    def at(x, y, z):
        return 4 * x + 2 * y + z

    quads = [[at(0, 0, 0), at(0, 0, 1), at(0, 1, 1), at(0, 1, 0)]]
    quads += [[at(x, 0, 0), at(x, 1, 0), at(x, 1, 1), at(x, 0, 1)] for x in (1, 2)]
    for x in (0, 1):
        quads += [
            [at(x, 0, 0), at(x + 1, 0, 0), at(x + 1, 0, 1), at(x, 0, 1)],
            [at(x, 1, 0), at(x, 1, 1), at(x + 1, 1, 1), at(x + 1, 1, 0)],
            [at(x, 0, 0), at(x, 1, 0), at(x + 1, 1, 0), at(x + 1, 0, 0)],
            [at(x, 0, 1), at(x + 1, 0, 1), at(x + 1, 1, 1), at(x, 1, 1)],
        ]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def test_a_wall_between_two_cells_leaves_no_slit():
    vertices, faces, _, said = mended(shared_wall())
    assert len(faces) == 20
    assert volume(vertices, faces) == pytest.approx(2)
    assert "left out: 2 faces between cells of one body" in said


def test_copies_of_faces_go_before_anything_else():
    ball = trimesh.creation.icosphere(3, 10)
    copied = np.concatenate([ball.faces, ball.faces[:100]])
    _, faces, _, _ = mended((ball.vertices, copied))
    assert len(faces) == len(ball.faces)


def voxels(size, seed):
    """The surface of random voxels, each square its own, so that edges have four faces."""
    filled = np.pad(np.random.default_rng(seed).random((size,) * 3) < 0.5, 1)
    quads = []
    for axis in range(3):
        u, w = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for side in (1, -1):
            for cell in np.argwhere(filled & ~np.roll(filled, -side, axis)):
                low = cell + np.eye(3)[axis] * (side > 0)
                quads.append([low, low + u, low + u + w, low + w][::side])
    corners = np.array(quads).reshape(-1, 3)
    index = np.arange(len(corners)).reshape(-1, 4)
    return corners, np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]]), filled.sum()


@pytest.mark.parametrize("seed", [0, 1])
def test_kissing_voxels_multiply_no_faces(seed):
    vertices, faces, filled = voxels(4, seed)
    fixed, fixed_faces, _, _ = mended((vertices, faces))
    assert volume(fixed, fixed_faces) == pytest.approx(filled, rel=1e-5)
    assert len(fixed_faces) < 2 * len(faces)


def test_a_sheet_inside_a_box_is_named_and_left_out():
    sheet = np.array([[0.2, 0.5, 0.2], [0.8, 0.5, 0.2], [0.8, 0.5, 0.8], [0.2, 0.5, 0.8]])
    said, (vertices, faces, *_) = remedied(joined(box(), (sheet, np.array([[0, 1, 2], [0, 2, 3]]))))
    assert "1 open pieces inside closed parts (2 of 14 faces)" in said
    assert volume(vertices, faces) == pytest.approx(1)


@pytest.mark.full
def test_debris_of_a_scan_is_named_and_left_out():
    ball = trimesh.creation.icosphere(3, 10)
    loose = ball.vertices[ball.faces[::100]] * 1.4
    bits = loose.mean(axis=1, keepdims=True) + 0.2 * (loose - loose.mean(axis=1, keepdims=True))
    debris = bits.reshape(-1, 3), np.arange(3 * len(bits)).reshape(-1, 3)
    mesh = joined((ball.vertices, np.asarray(ball.faces)[2:]), debris)
    said, (vertices, faces, *_) = remedied(mesh)
    assert f"{len(bits)} loose pieces that enclose nothing" in said
    assert np.linalg.norm(vertices[faces], axis=2).max() < 10.01
    assert volume(vertices, faces) == pytest.approx(ball.volume, rel=0.01)


def test_parts_with_small_holes_are_no_debris():
    """A bolt beside a plate, with a hole of one face: it is filled, as ever."""
    bolt = trimesh.creation.icosphere(2, 0.05)
    mesh = joined(box(), (bolt.vertices + 3, np.asarray(bolt.faces)[1:]))
    _, faces, _, _ = mended(mesh)
    assert len(faces) == 12 + len(bolt.faces)


def klein(n=24):
    """A Klein bottle: the figure of eight that turns over on its way around."""
    u, v = np.meshgrid(*[2 * np.pi * np.arange(n) / n] * 2, indexing="ij")
    r = 3 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    z = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1).reshape(-1, 3)

    def at(i, j):
        # once around, the other way about
        return (i % n) * n + ((-j) % n if i >= n else j % n)

    quads = [(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1))
             for i in range(n) for j in range(n)]  # fmt: skip
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def test_a_surface_of_one_side_is_called_that():
    said = refusal(klein())
    assert "are a closed surface with one side only" in said
    assert "`mesh: {open: thicken}`" in said


def test_what_has_no_volume_is_not_made_a_solid():
    vertices, faces = box()
    said = refusal((vertices * [1, 1, 0], faces))
    assert "the mesh lies in one plane: it has no volume" in said
    assert "`mesh: {open: thicken}`" in said


def test_faces_back_to_back_are_sheets():
    """A cup of five walls, each from both sides: no remedy for holes closes it as it is meant."""
    vertices, faces = box()
    lid = (vertices[faces][:, :, 2] > 0.99).all(axis=1)
    cup = faces[~lid]
    said = refusal((vertices, np.concatenate([cup, cup[:, ::-1]])))
    assert "back to back: sheets without thickness" in said
    assert "`mesh: {open: thicken}`" in said


@pytest.mark.full
@pytest.mark.parametrize("make", [klein, lambda: (box()[0] * [1, 1, 0], box()[1])])
def test_the_remedy_for_what_has_no_inside_works(make):
    remedied(make())


def test_matter_that_becomes_a_cavity_is_said():
    ball = trimesh.creation.icosphere(2, 1)
    inner = ball.vertices / 2, np.asarray(ball.faces)
    _, _, record, said = mended(joined((ball.vertices, np.asarray(ball.faces)), inner))
    assert "a solid inside another becomes a cavity" in said
    assert f"{ball.volume / 8:.4g} of " in said
    assert "`mesh: {nested: solid}` keeps it" in said
    assert record["after"]["cavities"] == 1

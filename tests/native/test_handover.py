"""A mesh that one thread moves while another asks: of one whole shape, in the end of the last."""

import threading

import numpy as np
import pytest
from test_queries import same
from test_refit import bent, points_around

from pandis.runtime.field import NativeField
from pandis.runtime.field.handover import SharedField

SHAPES = 400


@pytest.fixture(scope="module")
def mesh(fields, files):
    """Return the field of an exact mesh, points around it, and many shapes of its vertices."""
    field = fields["exact"]
    vertices = field.frame.to_mesh(field.engine.vertices)
    points = points_around(field.frame, vertices, 200)
    shapes = [bent(vertices, angle) for angle in np.linspace(0, 1.5, SHAPES)]
    return NativeField(files["exact"]), points, shapes


def test_before_the_first_refit_it_answers_as_the_field(mesh):
    field, points, _ = mesh
    assert same(SharedField(field).query(points), field.query(points))


def test_a_shape_that_was_taken_stays_until_the_next_is(mesh):
    field, points, shapes = mesh
    shared, moving = SharedField(field), field.moving()
    for number in (50, 100, 150, 200, 250):
        shared.refit(shapes[number])
        assert shared.take()
        assert not shared.take()
        moving.refit(shapes[number])
        wanted = moving.query(points)
        for other in range(5):
            shared.refit(shapes[other])
            assert same(shared.query(points), wanted)


def test_what_is_no_shape_is_not_handed_over(mesh):
    field, points, shapes = mesh
    shared = SharedField(field)
    shared.refit(shapes[9])
    shared.take()
    wanted, broken = shared.query(points), shapes[20].copy()
    broken[3, 1] = np.nan
    for _ in range(4):
        with pytest.raises(ValueError, match="the old shape stays"):
            shared.refit(broken)
        assert not shared.take()
        assert same(shared.query(points), wanted)
    with pytest.raises(ValueError, match=r"the mesh has .* vertices, not 3"):
        shared.refit(broken[:3])


def test_every_answer_while_another_thread_moves_it_is_of_one_whole_shape(mesh):
    """And of no earlier one than the answer before; in the end it is the last shape."""
    field, points, shapes = mesh
    moving, number = field.moving(), {}
    for index, shape in enumerate(shapes):
        moving.refit(shape)
        number[moving.query(points).distance.tobytes()] = index
    shared, taken = SharedField(field), threading.Semaphore(0)

    def move():
        for index, shape in enumerate(shapes):
            shared.refit(shape)
            if index % 50 == 49:  # so that some are asked, however threads are scheduled
                assert taken.acquire(timeout=60)

    thread, seen = threading.Thread(target=move), [0]
    thread.start()
    while thread.is_alive():
        if shared.take():
            taken.release()
        seen.append(number[shared.query(points).distance.tobytes()])
    thread.join()
    shared.take()
    seen.append(number[shared.query(points).distance.tobytes()])
    assert len(number) == SHAPES
    assert seen == sorted(seen)
    assert seen[-1] == SHAPES - 1
    assert len(set(seen)) > SHAPES // 100

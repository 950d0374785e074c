"""Operations in processes of their own: what ends one becomes an error here, with its reason."""

import mmap
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from pandis.pipeline.mesh import processes, tools
from pandis.pipeline.mesh.cleanup import clean
from pandis.pipeline.mesh.processes import (
    CpuTime,
    CpuTimeError,
    LimitError,
    Limits,
    MissingError,
    ToolError,
    forked,
)

LIMITS = Limits(60, 3)


@pytest.fixture
def worker():
    """Run operations as a worker of a data set does."""
    tools.isolate(False)
    yield
    tools.isolate(True)


def two_balls():
    ball = trimesh.creation.icosphere(subdivisions=2)
    both = trimesh.util.concatenate([ball, ball.copy().apply_translation((0.5, 0.1, 0.2))])
    return np.array(both.vertices), np.array(both.faces)


def forever():
    while True:
        pass


@pytest.mark.parametrize("operation", ["clean", "orient", "union", "fill"])
def test_a_copy_of_a_worker_gives_what_a_new_process_gives(operation, worker):
    copied = tools.call(operation, *two_balls(), seconds=60, memory_gb=3)
    tools.isolate(True)
    alone = tools.call(operation, *two_balls(), seconds=60, memory_gb=3)
    assert all(np.array_equal(*pair) for pair in zip(copied, alone, strict=True))


def test_what_a_function_says_ends_in_its_error():
    with pytest.raises(ToolError, match="^ValueError: no such face$"):
        forked(lambda: (_ for _ in ()).throw(ValueError("no such face")), LIMITS)
    with pytest.raises(MissingError, match="No module named 'nowhere'"):
        forked(lambda: __import__("nowhere"), LIMITS)
    with pytest.raises(ToolError, match="^two words$"):
        forked(lambda: sys.exit("two words"), LIMITS)
    with pytest.raises(ToolError, match=r"crashed \(signal 9\)"):
        forked(lambda: os.kill(os.getpid(), signal.SIGKILL), LIMITS)
    with pytest.raises(LimitError, match="needs more than 3 GiB of memory"):
        forked(lambda: np.ones(1 << 30), LIMITS)


def test_a_copy_never_goes_on_as_a_second_worker(monkeypatch):
    """Its own report may fail, as on a full disk: nothing may return into the caller's code."""
    pid, name = os.getpid(), processes.__name__
    monkeypatch.setattr(f"{name}.traceback.print_exc", lambda: 1 / 0)
    with pytest.raises(ToolError):
        forked(lambda: 1 / 0, LIMITS)
    assert os.getpid() == pid
    with pytest.raises(ToolError, match="caf"):
        forked(lambda: sys.exit("caf\udce9"), LIMITS)


def test_a_copy_may_use_what_is_lent_to_it_whatever_the_worker_has():
    room = mmap.mmap(-1, 8 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    forked(lambda: np.ones(1 << 24), Limits(60, 0.5))
    with pytest.raises(LimitError, match=r"needs more than 0\.5 GiB"):
        forked(lambda: np.ones(1 << 27), Limits(60, 0.5))
    room.close()


def test_a_copy_ends_with_its_worker_and_holds_none_of_its_pipes():
    """Else the end of a worker shows only when a copy ends, which nothing limits any more."""
    program = (
        "import os, signal\n"
        "from pandis.pipeline.mesh.processes import Limits, forked\n"
        "worker = os.getpid()\n"
        "forked(lambda: [os.kill(worker, signal.SIGKILL), signal.pause()], Limits(60, 3))\n"
    )
    reading, writing = os.pipe()
    with os.fdopen(reading) as answers:
        killed = subprocess.run([sys.executable, "-c", program], pass_fds=[writing], check=False)
        os.close(writing)
        assert killed.returncode == -signal.SIGKILL
        assert answers.read() == ""  # at once: no copy has the other end


def test_no_limit_is_too_large_for_a_timer():
    forked(lambda: processes.Clock(1e12), Limits(1e12, 3))


def test_a_function_that_hangs_is_ended(capfd):
    with pytest.raises(LimitError, match=r"took longer than 0\.2 s"):
        forked(forever, Limits(0.2, 3))
    forked(lambda: print("lost"), LIMITS)
    assert capfd.readouterr() == ("", "")  # output of copies would spoil that of a worker


@pytest.mark.parametrize("isolated", [True, False])
def test_cpu_time_is_lent_to_operations_and_not_to_their_start(isolated, worker):
    tools.isolate(isolated)
    lent = CpuTime(2.0)
    tools.call("fill", *two_balls(), seconds=60, memory_gb=3, cpu=lent)
    assert 1.5 < lent.left < 2.0  # importing alone takes about half a second
    lent = CpuTime(1e-3)
    with pytest.raises(CpuTimeError, match=r"took longer than 0\.001 CPU s"):
        tools.call("union", *two_balls(), seconds=60, memory_gb=3, cpu=lent)
    assert lent.left == 0


def test_a_limit_on_memory_is_that_of_the_operation():
    """It used to be set in a copy of the parent, which may be larger, as with CUDA."""
    program = (
        "import numpy as np, mmap\n"
        "from pandis.pipeline.mesh import tools\n"
        "room = mmap.mmap(-1, 8 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)\n"
        "corners = np.eye(3)\n"
        "tools.call('clean', corners, np.arange(3).reshape(1, 3), seconds=60, memory_gb=1)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_mesh_of_which_nothing_is_left_is_no_defect():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    for faces in ([[0, 0, 1], [1, 1, 2]], [[0, 1, 2], [0, 2, 1]]):
        _, left = clean(line, np.array(faces))
        assert len(left) in (0, 2)

"""Operations in processes of their own: what ends one becomes an error here, with its reason."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from pandis.pipeline.mesh import tools
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

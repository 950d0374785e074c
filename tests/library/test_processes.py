"""Operations in processes of their own: what ends one becomes an error here, with its reason."""

import mmap
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pandis.base.errors import PandisError
from pandis.pipeline.dataset.rows import Work
from pandis.pipeline.mesh import processes, tools
from pandis.pipeline.mesh.cleanup import clean
from pandis.pipeline.mesh.intake import read_mesh
from pandis.pipeline.mesh.processes import (
    CpuTime,
    CpuTimeError,
    LimitError,
    Limits,
    MissingError,
    ToolError,
    forked,
)
from pandis.pipeline.run.ask.members import Member
from support import ROOT, environment

LIMITS = Limits(60, 3)
ENVIRONMENT = environment(PYTHONPATH=str(ROOT / "workflow"))


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
    lacking = OSError("a.so: failed to map segment from shared object")
    with pytest.raises(LimitError, match="needs more than 3 GiB of memory"):
        forked(lambda: (_ for _ in ()).throw(lacking), LIMITS)


@pytest.mark.parametrize("isolated", [False, True])
def test_a_folder_may_be_called_like_a_lack_of_memory(isolated, worker, tmp_path):
    folder = tmp_path / "bad_alloc" / "MemoryError"
    folder.mkdir(parents=True)
    (folder / "box.obj").write_text("v 0 0\nf 1 2 3\n")
    tools.isolate(isolated)
    with pytest.raises(PandisError, match=r"MemoryError/box.obj: line 1: "):
        read_mesh(str(folder / "box.obj"), folder / "box.obj")


@pytest.mark.parametrize("fault", ["traceback.print_exc", "signal.alarm"])
def test_a_copy_never_goes_on_as_a_second_worker(fault, tmp_path):
    """Its own report may fail, as on a full disk: nothing may return into the caller's code."""
    program = (
        "import sys\n"
        "from pandis.pipeline.mesh import processes\n"
        f"processes.{fault} = lambda *_: 1 / 0\n"
        "try:\n"
        "    processes.forked(lambda: 1 / 0, processes.Limits(60, 3))\n"
        "except processes.ToolError:\n"
        "    pass\n"
        "finally:\n"
        "    open(sys.argv[1], 'a').write('went on\\n')\n"
    )
    log = tmp_path / "log"
    subprocess.run([sys.executable, "-c", program, log], check=True, env=ENVIRONMENT)
    assert log.read_text() == "went on\n"


def test_a_reason_that_cannot_be_encoded_is_told_all_the_same():
    with pytest.raises(ToolError, match="caf"):
        forked(lambda: sys.exit("caf\udce9"), LIMITS)


def test_a_copy_may_use_what_is_lent_to_it_whatever_the_worker_has():
    room = mmap.mmap(-1, 8 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    forked(lambda: np.ones(1 << 24), Limits(60, 0.5))
    with pytest.raises(LimitError, match=r"needs more than 0\.5 GiB"):
        forked(lambda: np.ones(1 << 27), Limits(60, 0.5))
    room.close()


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are not listed here")
def test_a_copy_has_no_file_of_its_worker():
    """A pipe in it would hide the worker's end from whoever reads the other end."""
    reading, writing = os.pipe()
    links = f"/proc/{os.getpid()}/fd/{writing}"
    pipe = os.readlink(links)

    def opened():
        kept = [os.readlink(path) for path in Path("/proc/self/fd").iterdir() if path.exists()]
        sys.exit(f"open: {pipe in kept} {len(kept)}")

    with pytest.raises(ToolError, match="^open: False [3-6]$"):
        forked(opened, LIMITS)
    os.close(reading), os.close(writing)


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is Linux's")
def test_a_copy_ends_with_its_worker():
    """Else nothing limits its time any more."""
    program = (
        "import os, signal\n"
        "from pandis.pipeline.mesh.processes import Limits, forked\n"
        "def run():\n"
        "    os.write(1, b'')\n"
        "    os.kill(os.getppid(), signal.SIGKILL)\n"
        "    signal.pause()\n"
        "forked(run, Limits(60, 3))\n"
    )
    worker = subprocess.Popen(
        [sys.executable, "-c", program], start_new_session=True, env=ENVIRONMENT
    )
    assert worker.wait() == -signal.SIGKILL
    deadline = time.monotonic() + 30
    while _members(worker.pid) and time.monotonic() < deadline:
        os.sched_yield()
    left = _members(worker.pid)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left


def _members(session):
    """Return the processes of a session that have not ended."""
    members = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                members.append(int(path.parent.name))
    return members


@pytest.mark.skipif(sys.platform != "linux", reason="ignored signals are not listed here")
def test_a_worker_waits_for_its_copies_whatever_it_inherits(tmp_path):
    """A parent that ignores SIGCHLD hands that down, and then nobody could wait for a copy."""
    previous = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        command = [sys.executable, "-m", "pandis.pipeline.dataset.worker", str(4 << 30)]
        worker = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
        )
    finally:
        signal.signal(signal.SIGCHLD, previous)
    work = Work(Member("a", str(tmp_path / "a.stl")), {}, {}, 0, output=str(tmp_path / "a.npz"))
    worker.stdin.write(work.to_json() + "\n")
    worker.stdin.flush()
    while "written" not in worker.stdout.readline():
        assert worker.poll() is None
    status = Path(f"/proc/{worker.pid}/status").read_text()
    ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
    assert not ignored >> signal.SIGCHLD - 1 & 1
    worker.communicate()


def test_no_limit_is_too_large_for_a_timer():
    forked(lambda: processes.Clock(1e12), Limits(1e12, 3))
    processes.spawned(["true"], dict(os.environ), Limits(1e12, 3))


def test_what_comes_after_an_operation_takes_nothing_of_its_time():
    def after():
        clock = processes.Clock(0.05)
        assert clock.stop() < 0.05
        end = time.process_time() + 0.2
        while time.process_time() < end:
            pass

    forked(after, LIMITS)


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
    subprocess.run([sys.executable, "-c", program], check=True, env=ENVIRONMENT)


def test_a_mesh_of_which_nothing_is_left_is_no_defect():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    for faces in ([[0, 0, 1], [1, 1, 2]], [[0, 1, 2], [0, 2, 1]]):
        _, left = clean(line, np.array(faces))
        assert len(left) in (0, 2)

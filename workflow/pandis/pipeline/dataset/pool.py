"""A pool of worker processes with limits for each task: what breaks one costs that task alone."""

import json
import os
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from pandis.base.children import python_path
from pandis.base.errors import PandisError

_WORKER = "pandis.pipeline.dataset.worker"
#: Tasks after which a worker is replaced, so that what libraries leak stays small.
_TASKS = 500
#: One thread, whose memory is in one arena: others would take address space, which is limited.
_ONE_THREAD = (
    "MALLOC_ARENA_MAX",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "IGL_NUM_THREADS",
)


class Lost(Exception):
    """A worker did not answer: the message says why, ``stage`` where.

    ``killed`` says that something else ended it, so that another try may succeed.
    """

    def __init__(self, stage, why, *, killed=False):
        super().__init__(why)
        self.stage, self.killed = stage, killed


class Pool:
    """Workers that answer tasks, each kept alive between tasks.

    Parameters
    ----------
    workers : int
    seconds : float
        Time limit of a task.
    memory_gb : float
        Limit on a worker's address space (GiB).
    """

    def __init__(self, workers, *, seconds, memory_gb):
        self.count, self.seconds, self.memory_gb = workers, seconds, memory_gb

    def answers(self, tasks):
        """Yield pairs of a task and what became of it, as they come.

        That is None if the task's output is written; stage and cause of a failure that is not
        written, as it might replace rows; or the `Lost` of a worker.

        Parameters
        ----------
        tasks : list of pandis.pipeline.dataset.rows.Work
        """
        waiting, done, stopped = SimpleQueue(), SimpleQueue(), threading.Event()
        for task in tasks:
            waiting.put(task)
        threads = [
            threading.Thread(target=self._serve, args=(waiting, done, stopped), daemon=True)
            for _ in range(min(self.count, len(tasks)))
        ]
        for thread in threads:
            thread.start()
        try:
            for _ in tasks:
                task, answer = done.get()
                if isinstance(answer, Exception) and not isinstance(answer, Lost):
                    raise answer
                yield task, answer
        finally:
            stopped.set()
            for thread in threads:
                thread.join()

    def _serve(self, waiting, done, stopped):
        worker, answered = None, 0
        try:
            while not stopped.is_set():
                try:
                    task = waiting.get_nowait()
                except Empty:
                    return
                if worker is None or answered >= _TASKS:
                    if worker:
                        worker.end()
                    worker, answered = _Worker(self.seconds, self.memory_gb, stopped), 0
                try:
                    done.put((task, worker.answer(task)))
                    answered += 1
                except Lost as lost:
                    worker.end()
                    worker = None
                    done.put((task, lost))
        except Exception as error:
            done.put((None, error))
        finally:
            if worker:
                worker.end()


class _Worker:
    """One process, in a session of its own so that what it started ends with it."""

    def __init__(self, seconds, memory_gb, stopped):
        self.seconds, self.memory_gb, self.stopped = seconds, memory_gb, stopped
        root = Path(__file__).resolve().parents[3]
        environment = os.environ | {"PYTHONPATH": python_path(root)}
        environment |= dict.fromkeys(_ONE_THREAD, "1")
        # a worker that is killed leaves its temporary files behind
        self.scratch = tempfile.mkdtemp(prefix="pandis-worker-")
        environment["TMPDIR"] = self.scratch
        self.process = subprocess.Popen(
            [sys.executable, "-m", _WORKER, str(int(memory_gb * 2**30))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
        )
        self._rest = b""

    def answer(self, task):
        """Return what `Pool.answers` yields of a task.

        Raises
        ------
        Lost
            The process ends or takes too long.
        """
        stage, until = "read", time.monotonic() + self.seconds
        with suppress(BrokenPipeError):  # the end of its output says why
            self.process.stdin.write(task.to_json().encode() + b"\n")
            self.process.stdin.flush()
        while True:
            message = json.loads(self._line(stage, until))
            if "refused" in message:
                raise PandisError(message["refused"])
            if "written" in message:
                return message.get("failed")
            stage = message["stage"]

    def _line(self, stage, until):
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            while b"\n" not in self._rest:
                left = until - time.monotonic()
                if left <= 0:
                    raise Lost(stage, f"it took longer than {self.seconds:g} s; raise seconds of "
                                      "the data set")  # fmt: skip
                if self.stopped.is_set():
                    raise Lost(stage, "stopped")
                if not selector.select(min(left, 0.5)):
                    continue
                block = os.read(self.process.stdout.fileno(), 1 << 16)
                if not block:
                    killed = self.process.wait() == -signal.SIGKILL
                    raise Lost(stage, self._end(), killed=killed)
                self._rest += block
        line, _, self._rest = self._rest.partition(b"\n")
        return line

    def _end(self):
        status = self.process.wait()
        if status == -signal.SIGKILL:
            return "its process was killed, perhaps because memory ran out"
        what = f"signal {-status}" if status < 0 else f"status {status}"
        return (
            f"its process ended ({what}); if it needs more memory than {self.memory_gb:g} GiB, "
            "raise memory_gb of the data set"
        )

    def end(self):
        """End the process and everything that it started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        with suppress(OSError):
            self.process.stdin.close()
        self.process.stdout.close()
        shutil.rmtree(self.scratch, ignore_errors=True)

"""A worker of the pool: labels one mesh after another, as its standard input names them.

A line of input is a task (JSON); a line of output is a note (``{"stage": …}``) or the answer to the
task. Whatever else a library prints goes to standard error.
"""

import ctypes
import json
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError, RepairError
from pandis.pipeline.dataset.rows import CHANGED, member_of, mesh_rows
from pandis.pipeline.mesh import tools


def write_rows(path, arrays, facts):
    """Write what a mesh came to: arrays, which may be empty, and facts."""
    part = Path(f"{path}.part")
    with part.open("wb") as stream:
        np.savez(stream, facts=np.array(json.dumps(facts)), **arrays)
    part.replace(path)


def failure(stage, reason, option=None):
    """Return the facts of a mesh that came to nothing."""
    return {"failed": {"stage": stage, "reason": reason, "option": option or {}}}


def _answer(task, note):
    stage = ["read"]

    def enter(name):
        if name != stage[0]:
            stage[0] = name
            note({"stage": name})

    arrays = {}
    try:
        arrays, facts = mesh_rows(
            member_of(task["member"]), task["mesh"], task["samples"], seed=task["seed"], note=enter
        )
    except RepairError as error:
        facts = failure("repair", str(error), error.option)
    except PandisError as error:
        facts = failure(stage[0], str(error))
        if CHANGED in str(error):
            return {"facts": facts}  # not remembered: the next plan has another digest
    except MemoryError:
        facts = failure(stage[0], "it needs more memory; raise memory_gb of the data set")
    except Exception as error:
        what = f"{type(error).__name__}: {error}"
        facts = failure(stage[0], f"a defect of pandis, please report it ({what})")
    write_rows(task["output"], arrays, facts | {"key": task["key"]})
    return {"written": task["output"]}


def main():
    """Answer tasks until standard input ends, or the parent does."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # Linux: PR_SET_PDEATHSIG
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]), hard))  # tools set their own limits
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    tools.isolate(False)

    def say(message):
        answers.write(json.dumps(message) + "\n")
        answers.flush()

    for line in sys.stdin:
        say(_answer(json.loads(line), say))


if __name__ == "__main__":
    main()

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
from pandis.pipeline.dataset.rows import CHANGED, Work, mesh_rows
from pandis.pipeline.mesh import tools
from pandis.pipeline.run.records.dataset import Failure, MeshFacts


def write_rows(path, facts, arrays=None):
    """Write what a mesh came to: facts, and arrays if there are any."""
    part = Path(f"{path}.part")
    with part.open("wb") as stream:
        np.savez(stream, facts=np.array(facts.model_dump_json()), **arrays or {})
    part.replace(path)


def failure(stage, reason, **more):
    """Return the facts of a mesh that came to nothing."""
    option = more.pop("option", {})
    return MeshFacts(failed=Failure(stage=stage, reason=reason, option=option), **more)


def _answer(work, note):
    """Label a mesh, write its rows or why there are none, and return the answer."""
    stage = ["read"]

    def enter(name):
        if name != stage[0]:
            stage[0] = name
            note({"stage": name})

    arrays = None
    try:
        arrays, facts = mesh_rows(work, enter)
    except RepairError as error:
        facts = failure("repair", str(error), option=error.option)
    except PandisError as error:
        # what was changed during the run has another digest in the next plan
        facts = failure(stage[0], str(error), again=CHANGED in str(error))
    except MemoryError:
        facts = failure(stage[0], "it needs more memory; raise memory_gb of the data set")
    except Exception as error:
        what = f"{type(error).__name__}: {error}"
        facts = failure(stage[0], f"a defect of pandis, please report it ({what})")
    write_rows(work.output, facts.model_copy(update={"key": work.key}), arrays)
    return {"written": work.output}


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
        say(_answer(Work.of_json(line), say))


if __name__ == "__main__":
    main()

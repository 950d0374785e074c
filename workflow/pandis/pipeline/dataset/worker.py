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

from pandis.base.errors import PandisError, ReadError, RepairError
from pandis.base.files import AtomicFile
from pandis.pipeline.dataset.fields import field_file, join_fields, missing_fields, stored_mesh
from pandis.pipeline.dataset.reading import DAMAGED, FILES, MESH, ROWS, Shard
from pandis.pipeline.dataset.rows import PassingError, Work, mesh_rows
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.mesh import tools
from pandis.pipeline.mesh.processes import lacks_memory
from pandis.pipeline.run.records.dataset import Failure, MeshFacts

#: Why a mesh failed that needs too much.
_MEMORY = "it needs more memory; raise memory_gb of the data set"


def write_rows(path, facts, arrays=None):
    """Write what a mesh came to: facts, and arrays if there are any.

    The file is not flushed to the disk: after a power cut, a damaged one is computed again.

    Raises
    ------
    PandisError
        The disk is full, or the folder is not writable.
    """
    part = Path(f"{path}.part")
    try:
        with part.open("wb") as stream:
            np.savez(stream, facts=np.array(facts.model_dump_json()), **arrays or {})
        part.replace(path)
    except OSError as error:
        raise AtomicFile(path).explain(error) from error


def read_rows(path):
    """Return the facts and arrays that `write_rows` wrote, or None if there are none undamaged."""
    try:
        with np.load(path) as stored:
            facts = MeshFacts.model_validate_json(str(stored["facts"]))
            names = () if facts.failed else ROWS | MESH | FILES
            return facts, {name: stored[name] for name in names}
    except DAMAGED:
        return None


def failure(stage, reason, **more):
    """Return the facts of a mesh that came to nothing."""
    option = more.pop("option", {})
    return MeshFacts(failed=Failure(stage=stage, reason=reason, option=option), **more)


def _explain(error, limits):
    """Return what to record of an error: the reason, and when to try again."""
    if lacks_memory(error):
        return {"reason": _MEMORY, "limits": limits}
    if isinstance(error, RepairError):
        return {"reason": str(error), "option": error.option}
    if isinstance(error, PandisError):
        return {"reason": str(error), "again": isinstance(error, PassingError | ReadError)}
    if isinstance(error, OSError):
        what = error.strerror or str(error)
        return {"reason": f"a file cannot be read or written: {what}", "again": True}
    what = f"{type(error).__name__}: {error}"
    return {"reason": f"a defect of pandis, please report it ({what})", "limits": limits}


def _known_rows(work):
    """Return arrays, facts and the mesh of a task whose rows were written before, or None."""
    facts, arrays = read_rows(work.output) or (None, None)
    if facts is None or facts.failed or facts.key != work.key:
        if work.before is None:
            return None
        import zarr

        # more threads would take more address space, which is limited
        zarr.config.set({"threading.max_workers": 1, "async.concurrency": 1})
        shard, place = Shard(work.before[0]), work.before[1]
        facts, arrays = shard.meshes[place], shard.arrays(place)
    return None if facts.materials else (arrays, facts, stored_mesh(arrays, facts))


def _add_fields(work, arrays, facts, *, mesh, enter):
    """Write the rows, then with each missing field, or with why it cannot be built."""
    write_rows(work.output, facts, arrays)  # they are safe, whatever becomes of a field
    body = Body.open(mesh)
    for name in missing_fields(work, facts):
        enter(f"field {name}")
        files, unbuilt = {}, {}
        try:
            files[name] = field_file(name, work, mesh=mesh, body=body)
        except Exception as error:
            unbuilt[name] = _explain(error, list(work.limits))
        arrays, facts = join_fields(work, arrays, facts, files=files, unbuilt=unbuilt)
        write_rows(work.output, facts, arrays)


def _answer(work, note):
    """Label a mesh, write its rows or why there are none, and return the answer.

    A failure is not written over what was there: it is part of the answer.
    """
    stage = ["read"]

    def enter(name):
        if name != stage[0]:
            stage[0] = name
            note({"stage": name})

    limits = list(work.limits)
    try:
        arrays, facts, mesh = _known_rows(work) or mesh_rows(work, enter)
    except Exception as error:
        return _fail(work, stage[0], _explain(error, limits))
    enter("store")
    try:
        if missing_fields(work, facts):
            _add_fields(work, arrays, facts, mesh=mesh, enter=enter)
        else:
            write_rows(work.output, facts, arrays)
    except PandisError as error:
        return {"refused": str(error)}
    except Exception as error:
        return _fail(work, stage[0], _explain(error, limits))
    return {"written": work.output}


def _fail(work, stage, cause):
    """Return the answer of a mesh that failed; write why, unless there may be rows."""
    if work.before is not None or Path(work.output).is_file():
        return {"written": work.output, "failed": [stage, cause]}
    try:
        write_rows(work.output, failure(stage, **cause, key=work.key))
    except PandisError as error:
        return {"refused": str(error)}
    return {"written": work.output}


def main():
    """Answer tasks until standard input ends, or the parent does."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # Linux: PR_SET_PDEATHSIG
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # copies of this process are waited for
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]), hard))  # tools set their own limits
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    tools.isolate(False)

    def say(message):
        try:
            answers.write(json.dumps(message) + "\n")
            answers.flush()
        except OSError:  # nobody listens: what this mesh comes to must not be written
            os._exit(1)

    for line in sys.stdin:
        say(_answer(Work.of_json(line), say))


if __name__ == "__main__":
    main()

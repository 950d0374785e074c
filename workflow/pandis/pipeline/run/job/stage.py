"""Runs a script as a stage, and handles its log, errors, threads, progress and artifact.

Every script wraps a few calls of the library in ``with stage(snakemake, Task) as job:``; ``Task``
is the model of its options. Snakemake runs a script in a process of its own. The functions of
`pandis.pipeline.api` run the same scripts in the caller's process, through `here`.

The job's log also appears on the terminal. Errors appear there only if the log goes to an object
store: otherwise Snakemake itself prints the log of a failed job.
"""

import hashlib
import json
import os
import signal
import sys
import time
import traceback
import warnings
from contextlib import contextmanager
from pathlib import Path

from threadpoolctl import threadpool_limits

from pandis.base.errors import PandisError
from pandis.base.files import file_digest, write_atomically
from pandis.base.progress import Context
from pandis.pipeline.run.ask.sourcing import source_digest, source_files
from pandis.pipeline.run.job.artifact import (
    ArtifactWriter,
    read_artifact,
    write_artifact,
)
from pandis.pipeline.run.job.limits import limited
from pandis.pipeline.run.job.provenance import CodeDigests, combine, needs, provenance
from pandis.pipeline.run.job.stored import RESULTS, is_copy, original

PROGRESS_SECONDS = 5.0
CHANGED = "the code was changed after this run was planned; run the same command again"
#: Message of a job that was stopped.
INTERRUPTED = "interrupted; run the same command again to go on: finished work is kept"


#: Environment variables that set the thread count of a BLAS loaded later or by a child process.
_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")


def _interrupt(number, frame):
    raise KeyboardInterrupt


def stage(snakemake, task):
    """Return the context in which a script's body runs as a stage; it yields a `Job`.

    Parameters
    ----------
    snakemake : object
        The object that Snakemake injects into a script, or the one that replaces it: that one has
        a member ``stage``, which is called instead of `process`.
    task : type
        Model of this stage's options, from `pandis.pipeline.run.ask.tasks`.
    """
    return getattr(snakemake, "stage", process)(snakemake, task)


@contextmanager
def here(snakemake, task):
    """Run a stage in the caller's process, whose signals, environment and output stay its own.

    Exceptions reach the caller.

    ``snakemake`` also has ``script``, the name of the stage, and ``show``, the caller's log.
    """
    job = Job(snakemake, task, snakemake.script, show=snakemake.show)
    try:
        job.check_code()
        with threadpool_limits(1, user_api="blas"):
            yield job
    finally:
        job.close()


@contextmanager
def process(snakemake, task):
    """Run a stage as a process of its own, whose signals, threads and limits it sets.

    Notes
    -----
    A `PandisError` ends the process with only its message, any other exception with its traceback.
    Both go to the stage's log, which Snakemake shows unless the log goes to an object store.
    """
    # the name of the script, not of the rule, because another workflow may rename the rule
    job = Job(snakemake, task, Path(sys.modules["__main__"].__file__).stem)
    signal.signal(signal.SIGTERM, _interrupt)
    os.environ["IGL_NUM_THREADS"] = str(snakemake.threads)
    # the order in which a BLAS sums depends on its thread count, and Snakemake sets that to the
    # job's thread count
    os.environ.update(dict.fromkeys(_BLAS_THREADS, "1"))
    warnings.showwarning = lambda message, category, *_: job.log(f"warning: {message}")
    resources = snakemake.resources
    try:
        job.check_code()
        with (
            limited(job.stage, resources.get("runtime"), resources.get("mem_mb"), job=job),
            threadpool_limits(1, user_api="blas"),
        ):
            yield job
    except PandisError as error:
        job.log(f"error: {error}", terminal=is_copy(snakemake.log[0]))
        job.close()
        sys.exit(1)
    except KeyboardInterrupt:
        job.log(INTERRUPTED, terminal=False)
        job.close()
        sys.exit(1)
    except BaseException:
        job.log(traceback.format_exc(), terminal=is_copy(snakemake.log[0]))
        job.close()
        # not raised again: Snakemake shows the log, which contains the traceback
        sys.exit(1)
    job.log("done")
    job.close()


class Job:
    """One running stage: inputs, options, log and output."""

    def __init__(self, snakemake, task, name, *, show=None):
        self._snakemake, self.stage = snakemake, name
        self._show = show or (lambda text: print(text, file=sys.stderr, flush=True))
        self.mesh = snakemake.wildcards.get("mesh")
        self._params, self._task = dict(snakemake.params.options), task
        #: The options, as an instance of the stage's model; set by `check_code`.
        self.options = None
        self.threads = snakemake.threads
        self.input = snakemake.input
        self.output = snakemake.output
        extra = [v for k, v in snakemake.wildcards.items() if k not in ("mesh", "extension")]
        self.name = " ".join([self.mesh or "all meshes", self.stage, *map(str, extra)])
        #: SHA-256 of the source set; empty if the stage reads none.
        self.source = snakemake.params.get("source", "")
        self._inputs = {}
        #: The results folder, which contains the logs.
        self._folder = original(snakemake.log[0]).rpartition("/logs/")[0]
        self._start = self.last_line = time.monotonic()
        path = Path(snakemake.log[0])
        path.parent.mkdir(parents=True, exist_ok=True)
        self._log = path.open("w", encoding="utf-8")
        self.log("started")

    def log(self, text, terminal=True):
        """Write a line to the stage's log and, by default, to the terminal."""
        self.last_line = time.monotonic()
        self._log.write(f"[{time.monotonic() - self._start:8.2f} s] {text}\n")
        self._log.flush()
        if terminal:
            self._show(f"{self.name}: {text}")

    @property
    def stream(self):
        """The open log."""
        return self._log

    def close(self):
        """Close the log."""
        self._log.close()

    def check_code(self):
        """Raise if the code is not the code that was planned; otherwise set the options."""
        here = Path(__file__).resolve().parents[3]
        self._code = digests = CodeDigests(self.workflow())
        expected = digests.root / "pandis"
        if here != expected:
            raise PandisError(
                f"the library was imported from {here}, but this workflow needs {expected}; "
                "uninstall the imported one: pip uninstall pandis-fields"
            )
        # digest now, while the files are still those that this process has imported
        self._modules = digests.modules(self.stage, needs(self._params))
        if combine(self._modules) != self._snakemake.params.code:
            raise PandisError(CHANGED)
        try:
            self.options = self._task(**self._params)
        except ValueError as error:
            raise PandisError(f"{CHANGED} ({error})") from error

    def code_of_fields(self, names):
        """Return the digest of the part of this stage's code that these of its fields need."""
        return combine(self._code.modules(self.stage, needs({"builds": dict.fromkeys(names)})))

    def checkpoint(self):
        """Return the path where an unfinished result may be stored.

        It is keyed by everything the result depends on, so a job with changed options never resumes
        an older run. It is not an output of the rule, so Snakemake does not delete it.
        """
        why = self.provenance()
        parts = [why["options"], why["code"]["digest"], why["inputs"], why["versions"]]
        text = json.dumps(parts, sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:24]
        output = Path(self.output[0])
        return output.parent / ".resume" / f"{output.name.split('.')[0]}.{key}.pt"

    # --- inputs and output -----------------------------------------------------

    def read(self, name, kind):
        """Read the input artifact ``name`` of the rule and record its digest."""
        return self.read_path(self.input[name], kind)

    def read_path(self, path, kind=None):
        """Read an artifact among the rule's inputs and record its digest."""
        artifact = read_artifact(path, kind)
        self.note_digest(path, artifact.digest)
        return artifact

    def read_input(self, path):
        """Read an input if it is an artifact; if it is an exported file, return its path."""
        return self.read_path(path) if str(path).endswith(".zarr.zip") else self.note_file(path)

    def note_digest(self, path, digest):
        """Record the digest of an input that was read."""
        name = original(path)
        if name.startswith(f"{self._folder}/"):
            name = RESULTS + name.removeprefix(self._folder)
        self._inputs[name] = digest

    def note_file(self, path):
        """Record the SHA-256 of an input that is a plain file; return its path."""
        self.note_digest(path, file_digest(path))
        return Path(path)

    def check_source(self, path):
        """Refuse a source that has changed since the run was planned."""
        if self.source and source_digest(source_files(path)) != self.source:
            raise PandisError(
                f"{path}, or a file that it names, was changed after this run was planned; run the "
                "same command again"
            )

    def workflow(self):
        """Return the folder of the Snakefile."""
        return Path(self._snakemake.scriptdir).resolve().parent / "workflow"

    def provenance(self):
        """Return the provenance of this job's output."""
        wildcards = {key: str(value) for key, value in self._snakemake.wildcards.items()}
        inputs = dict(sorted(self._inputs.items()))
        why = provenance(self.stage, wildcards, self._params, modules=self._modules, inputs=inputs)
        return why | ({"source": self.source} if self.source else {})

    def write(self, kind, arrays, attributes, *, chunks=None):
        """Write the rule's first output as an artifact."""
        path = self.output[0]
        write_artifact(
            path, kind, arrays, attributes=attributes, provenance=self.provenance(), chunks=chunks
        )
        self.log(f"wrote {path} ({Path(path).stat().st_size / 1e6:.2f} MB)")

    def write_pieces(self, kind, columns, pieces, *, attributes):
        """Write the rule's first output piece by piece, so that it need not fit into memory.

        Parameters
        ----------
        kind : str
        columns : dict of str to dict
            Arguments of `pandis.pipeline.run.job.artifact.ArtifactWriter.declare`, by array.
        pieces : iterable of dict of str to ndarray
            The next rows of every array.
        attributes : dict
        """
        path = self.output[0]
        with ArtifactWriter(path, kind) as writer:
            for name, column in columns.items():
                writer.declare(name, **column)
            for piece in pieces:
                for name in columns:
                    writer.append(name, piece[name])
            writer.finish(attributes, self.provenance())
        self.log(f"wrote {path} ({Path(path).stat().st_size / 1e6:.2f} MB)")

    def write_file(self, data, index=0):
        """Write one of the rule's outputs as a plain file, atomically."""
        path = self.output[index]
        write_atomically(path, data)
        self.log(f"wrote {path} ({len(data) / 1e6:.2f} MB)")

    def context(self):
        """Return the `Context` of a computation that this job may resume."""
        return Context(self.checkpoint(), self.progress, self.log)

    def progress(self, what, total, unit="points"):
        """Return a `TimedReport` to this job's log."""
        return TimedReport(self.log, what, total, unit=unit)


class TimedReport:
    """Reports the progress of a long computation every few seconds.

    Parameters
    ----------
    log : pandis.base.progress.Log
    what : str
        Name of the computation.
    total : float
        Amount of work, in ``unit``.
    unit : str
    """

    def __init__(self, log, what, total, *, unit):
        self.log, self.what, self.total, self.unit = log, what, total, unit
        self.start = self.last = time.monotonic()
        self.offset = 0

    def resume(self, done):
        """Set the amount that an earlier run finished; it is left out of the rate."""
        self.offset = done

    def update(self, done, note=""):
        """Report that ``done`` of ``total`` is finished, at most once every few seconds."""
        now = time.monotonic()
        if now - self.last < PROGRESS_SECONDS and done < self.total:
            return
        if done >= self.total and self.last == self.start and now - self.start < PROGRESS_SECONDS:
            return  # short work needs no report beyond the stage's "done"
        self.last = now
        rate = (done - self.offset) / max(now - self.start, 1e-9)
        left = (self.total - done) / rate if rate > 0 else float("inf")
        speed = f"{rate:,.0f}/s" if rate >= 10 else f"{rate:.2g}/s"
        self.log(
            f"{self.what}: {done:,.0f} of {self.total:,.0f} {self.unit} "
            f"({100 * done / self.total:.0f} %), {speed}, {left:.0f} s left"
            + (f", {note}" if note else "")
        )


def silent_progress(what, total, unit="points"):
    """Return a `TimedReport` that logs nothing, for use outside a stage."""
    return TimedReport(lambda text: None, what, total, unit=unit)

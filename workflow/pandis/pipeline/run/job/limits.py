"""Limits on a stage's time and memory: a stage that exceeds one ends with a message.

Rules state minutes and memory for clusters; this module enforces the same limits. Most parts of a
stage have more specific limits with better messages. These limits cover the rest.
"""

import faulthandler
import os
import threading
import time
from contextlib import contextmanager

#: Seconds without a line of the log after which a stage says that it is still running.
_SILENT = 30.0
#: Seconds between checks of time and memory.
_EVERY = 1.0
#: Seconds after the time limit in which a stage can still report the limit itself.
_GRACE = 20.0


@contextmanager
def limited(name, minutes, megabytes, *, job):
    """Run the body of a stage within limits; the process ends if it exceeds one.

    Parameters
    ----------
    name : str
        The rule's name.
    minutes, megabytes : float or None
        None: no limit.
    job : pandis.pipeline.run.job.stage.Job
        Its log receives a line that names the exceeded limit and says what to do, and one whenever
        nothing else has been logged for `_SILENT` seconds; its stream receives a traceback if the
        process can no longer report the limit itself.
    """
    over = threading.Event()
    start = time.monotonic()

    def look():
        while not over.wait(_EVERY):
            reason = _beyond(name, minutes, megabytes, seconds=time.monotonic() - start)
            if reason:
                job.log(f"error: {reason}")
                os._exit(1)
            if time.monotonic() - job.last_line > _SILENT:
                used = resident_megabytes()
                job.log(f"running for {time.monotonic() - start:.0f} s, {used:,.0f} MB of memory")

    if minutes:  # in C: works even while other code holds the GIL
        faulthandler.dump_traceback_later(60 * minutes + _GRACE, exit=True, file=job.stream)
    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        faulthandler.cancel_dump_traceback_later()


def _beyond(name, minutes, megabytes, *, seconds):
    """Return a message about the exceeded limit; empty if there is none."""
    if minutes and seconds > 60 * minutes:
        return (
            f"it has run for longer than the allowed {minutes:g} minutes; allow more with "
            f"--set-resources {name}:runtime={2 * minutes:g}, or reduce its work"
        )
    used = resident_megabytes()
    if megabytes and used > megabytes:
        return (
            f"it uses {used:,.0f} MB of memory, but only {megabytes:,.0f} MB are allowed; allow "
            f"more with --set-resources {name}:mem_mb={round(2 * used, -3):.0f}, or reduce its work"
        )
    return ""


def resident_megabytes():
    """Return the resident memory of this process (MB); 0 if the system does not report it."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0

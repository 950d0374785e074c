"""A stage that takes too long or too much memory ends, with a sentence that says what to do."""

import os
import subprocess
import sys
from multiprocessing import active_children

import pytest

from pandis.base.errors import PandisError
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.job.limits import _beyond, resident_megabytes
from support import ROOT, environment

BODY = """
import sys
from pandis.pipeline.run.job.limits import limited
from pandis.pipeline.run.job import limits
limits._EVERY, limits._SILENT = 0.01, {silent}
from types import SimpleNamespace
import time
job = SimpleNamespace(log=print, stream=sys.stderr, last_line=time.monotonic())
with limited("bake", {minutes}, {megabytes}, job=job):
    {body}
print("done")
"""


def run(body, minutes=None, megabytes=None, silent=60):
    code = BODY.format(body=body, minutes=minutes, megabytes=megabytes, silent=silent)
    return subprocess.run(
        [sys.executable, "-u", "-c", code],
        env=environment(PYTHONPATH=str(ROOT / "workflow")),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (
            {"minutes": 1e-3},
            "allowed 0.001 minutes; allow more with --set-resources bake:runtime",
        ),
        ({"megabytes": 1}, "only 1 MB are allowed; allow more with --set-resources bake:mem_mb"),
    ],
)
def test_a_body_that_never_ends_is_ended_in_a_sentence(limits, said):
    done = run("import threading; threading.Event().wait()", **limits)
    assert done.returncode == 1
    assert said in done.stdout
    assert "done" not in done.stdout


def test_what_keeps_its_limits_is_left_alone():
    done = run("pass", minutes=1, megabytes=4000)
    assert done.stdout == "done\n"
    assert _beyond("x", None, None, seconds=1e9) == ""
    assert resident_megabytes() > 10


def test_a_stage_that_logs_nothing_says_that_it_is_running():
    wait = "said = []; job.log = said.append\n    while not said: time.sleep(0.001)"
    done = run(f"{wait}\n    print(said[0])", silent=0.05)
    assert "running for 0 s" in done.stdout
    assert " MB of memory" in done.stdout


# --- processes ---------------------------------------------------------------------------


def test_processes_answer_in_order_and_see_what_their_parent_holds():
    held = {"offset": 7}
    assert list(each(lambda k: (k + held["offset"], os.getpid()), [1], 4)) == [(8, os.getpid())]
    found = list(each(lambda k: (k + held["offset"], os.getpid()), range(6), 2))
    assert [value for value, _ in found] == [7, 8, 9, 10, 11, 12]
    assert os.getpid() not in {process for _, process in found}


def test_an_error_in_a_process_is_the_stages_and_leaves_none_behind():
    def work(k):
        if k == 1:
            raise PandisError("the second is bad")
        return k

    with pytest.raises(PandisError, match="the second is bad"):
        list(each(work, range(5), 2))
    assert not active_children()

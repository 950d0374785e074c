"""Say which branches of the C code the tests take, by gcov.

Usage: .venv/bin/python tests/benchmarks/coverage.py [TEST…]
Every C file is compiled with gcov's counters, in a cache of its own, and what ran is summed up over
all that was compiled of a file. Printed are the share of branches taken in pandis.h, the contacts,
the guard and the client, and the lines with branches that were not, with the reason where one is
known. Nothing is inlined, and copies of a function for several processors count as one. Processes
that raise a signal count before; those that are killed count nothing. Without TEST it is
tests/native, and what else asks fields.
"""

import gzip
import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "workflow" / "pandis"
LIBRARY = ("test_compact", "test_spline", "test_fields_and_export", "test_stress_proxy")
TESTS = ("tests/native", *(f"tests/library/{name}.py" for name in LIBRARY))
#: Written for gcc; the name of a library's counters is that of its process.
COMPILER = """#!/bin/sh
case " $* " in
*" -c "*) ;;
*) set -- "$@" "{raising}" -Wl,--wrap=raise ;;
esac
exec {gcc} "$@" -O1 -fno-inline --coverage -fprofile-update=atomic -dumpdir "{counts}/$$-"
"""
#: A signal that ends a process would take its counts along.
RAISING = """void __gcov_dump(void); int __real_raise(int), __wrap_raise(int);
int __wrap_raise(int number) { __gcov_dump(); return __real_raise(number); }
"""
#: What is reported, of workflow/pandis.
FILES = ("engine/pandis.h", "runtime/contact/contact.c", *(f"runtime/device/{name}" for name in (
    "guard.h", "energy.h", "shaking.h", "client.c", "signals.h", "watchdog.h", "hd.h", "bridge.h",
)))  # fmt: skip
#: Why no test takes a branch of a line that begins so.
REASONS = {
    "for (int k = 0; k < 64": "no library has reported sixty-four errors at once",
    "if (__atomic_load_n(&client.inside": "a crash elsewhere in the middle of a callback is chance",
    "if (torque)": "no client gives torques; drivers take them for those that will",
    "for (int k = 0; k < 16; k++) {": "no library has reported sixteen errors between two ticks",
    "if (flag == PANDIS_INVALID) guard_end": "positions that are no numbers end runs before",
    "if (g->cause || (tick >= order->ticks": "after its last tick a run asks for no force",
    "if (now.tv_sec > due.tv_sec": "late by a second: the watchdog has ended the run before",
    "if (client_signal)": "a process that ends by a signal counts nothing",
    "__atomic_load_n(&client.cancelled, __ATOMIC_SEQ_CST) == CAUSE_WATCHDOG": "a callback that "
    "hangs is tried in a process that has to be killed, which counts nothing",
    "__atomic_store_n(&client_state, outcome->hangs": "likewise",
}


def counted(tests):
    """Run the tests; return per file the count of each branch, by line and number in it."""
    with tempfile.TemporaryDirectory() as place:
        counts = Path(place) / "counts"
        counts.mkdir()
        raising, compiler = Path(place) / "raising.c", Path(place) / "gcc"
        raising.write_text(RAISING)
        text = COMPILER.format(gcc=shutil.which("gcc"), counts=counts, raising=raising)
        compiler.write_text(text)
        compiler.chmod(compiler.stat().st_mode | stat.S_IXUSR)
        path = f"{place}{os.pathsep}{os.environ['PATH']}"  # tests compile programs of their own
        extra = {"CC": str(compiler), "PATH": path, "XDG_CACHE_HOME": place}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        subprocess.run(command, env=os.environ | extra, cwd=ROOT, check=False)
        found = defaultdict(lambda: defaultdict(int))
        for notes in counts.glob("*.gcno"):
            if not notes.with_suffix(".gcda").exists():
                continue
            command = ["gcov", "--branch-probabilities", "--json-format", "--stdout", notes]
            done = subprocess.run(command, cwd=place, capture_output=True, check=True)
            data = gzip.decompress(done.stdout) if done.stdout[:2] == b"\x1f\x8b" else done.stdout
            for part in data.splitlines():
                _add(json.loads(part), found)
    return found


def _add(report, found):
    for file in report["files"]:
        path = Path(os.path.normpath(ROOT / file["file"]))
        if not path.is_relative_to(PACKAGE):
            continue
        seen = defaultdict(int)
        for line in file["lines"]:
            for branch in line["branches"]:
                if branch["throw"]:
                    continue
                key = line["line_number"], line.get("function_name", "").split(".")[0]
                number = seen[key]
                seen[key] += 1
                found[str(path.relative_to(PACKAGE))][key[0], number] += branch["count"]


def main(tests):
    found = counted(tests or TESTS)
    for name in FILES:
        branches = found.get(name)
        if not branches:
            print(f"{name}: not compiled")
            continue
        taken = sum(count > 0 for count in branches.values())
        print(f"{name}: {100 * taken / len(branches):.1f} % of {len(branches):,} branches")
        lines = (PACKAGE / name).read_text().splitlines()
        missed = sorted({line for (line, _), count in branches.items() if not count})
        for line in missed:
            text = lines[line - 1].strip()
            reason = next((why for begin, why in REASONS.items() if text.startswith(begin)), "")
            print(f"  {line}: {text[:110]}{reason and '  -- ' + reason}")


if __name__ == "__main__":
    main(sys.argv[1:])

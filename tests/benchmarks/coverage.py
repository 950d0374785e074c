"""Say which branches of the C code the tests take, by clang's own counters.

Usage: .venv/bin/python tests/benchmarks/coverage.py [TEST…]
Needs Debian's clang and llvm. Every C file is compiled with counters for each condition of the
source, in a cache of its own, and what ran is summed up over all that was compiled of a file, with
copies for several processors and inlined ones. Printed are the share of outcomes taken in pandis.h,
the contacts, the guard and the client, and the lines with conditions that were never true or never
false, with the reason where one is known. Processes that raise a signal count before; those that
are killed count nothing. The workers of pytest-xdist may be, so -n is refused. Without TEST it is
tests/native, and what else asks fields.
"""

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
#: Stands for the compiler. What it links is put by, for tests remove theirs.
COMPILER = """#!/bin/sh
case " $* " in
*" -c "*|*" -E "*|*" -dM "*|*" --version "*) exec {clang} "$@" {flags} ;;
esac
{clang} "$@" {flags} "{raising}" -Wl,--wrap=raise || exit $?
made=a.out
while [ $# -gt 0 ]; do
    [ "$1" = -o ] && made=$2
    shift
done
cp "$made" "{binaries}/$$"
"""
FLAGS = "-Wno-everything -O1 -fprofile-instr-generate -fcoverage-mapping"
#: A signal that ends a process would take its counts along.
RAISING = """int __llvm_profile_write_file(void); int __real_raise(int), __wrap_raise(int);
int __wrap_raise(int number) { __llvm_profile_write_file(); return __real_raise(number); }
"""
#: What is reported, of workflow/pandis.
FILES = ("engine/pandis.h", "runtime/contact/contact.c", *(f"runtime/device/{name}" for name in (
    "guard.h", "energy.h", "shaking.h", "client.c", "ticks.h", "signals.h", "watchdog.h", "hd.h",
    "bridge.h",
)))  # fmt: skip
#: Why no test takes a branch of a line that begins so.
REASONS = {
    "for (int k = 0; k < 64": "no library has reported sixty-four errors at once",
    "if (__atomic_load_n(&client.inside": "a crash elsewhere in the middle of a callback is chance",
    "unsigned int device = api.init_device(name": "no caller gives no name at all",
    "hd.device = hd.api.init_device(name": "likewise",
    "size_t count = touched < most": "followers have room for every object that may be touched",
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
    """Run the tests; return per file how often each outcome was met, by its condition's place."""
    with tempfile.TemporaryDirectory() as place:
        binaries, counts = Path(place) / "binaries", Path(place) / "counts"
        binaries.mkdir()
        raising, compiler = Path(place) / "raising.c", Path(place) / "gcc"
        raising.write_text(RAISING)
        text = COMPILER.format(
            clang=shutil.which("clang"), flags=FLAGS, raising=raising, binaries=binaries
        )
        for name in (compiler, compiler.with_name("clang")):  # tests compile with both
            name.write_text(text)
            name.chmod(name.stat().st_mode | stat.S_IXUSR)
        path = f"{place}{os.pathsep}{os.environ['PATH']}"
        extra = {"CC": str(compiler), "PATH": path, "XDG_CACHE_HOME": place}
        extra["LLVM_PROFILE_FILE"] = f"{counts}/%m.profraw"  # processes add theirs up
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        subprocess.run(command, env=os.environ | extra, cwd=ROOT, check=False)
        return _summed(list(binaries.iterdir()), list(counts.glob("*.profraw")), place)


def _summed(binaries, counts, place):
    profile, outcomes = f"{place}/all.profdata", defaultdict(lambda: defaultdict(int))
    merge = ["llvm-profdata", "merge", "-sparse", "-o", profile, *map(str, counts)]
    subprocess.run(merge, check=True, capture_output=True)
    for binary in binaries:
        export = ["llvm-cov", "export", f"-instr-profile={profile}", str(binary)]
        done = subprocess.run(export, check=False, capture_output=True)
        for report in json.loads(done.stdout)["data"] if not done.returncode else ():
            for function in report["functions"]:
                _add(function, outcomes)
    return outcomes


def _add(function, outcomes):
    for line, column, _, _, met, unmet, file, *_ in function["branches"]:
        path = Path(os.path.normpath(ROOT / function["filenames"][file]))
        if path.is_relative_to(PACKAGE):
            counts = outcomes[str(path.relative_to(PACKAGE))]
            counts[line, column, True] += met
            counts[line, column, False] += unmet


def main(tests):
    if any(word.startswith("-n") for word in tests):
        sys.exit("error: leave out -n: workers may end before they have written their counts")
    found = counted(tests or TESTS)
    for name in FILES:
        branches = found.get(name)
        if not branches:
            print(f"{name}: not compiled")
            continue
        taken = sum(count > 0 for count in branches.values())
        print(f"{name}: {100 * taken / len(branches):.1f} % of {len(branches):,} branches")
        lines = (PACKAGE / name).read_text().splitlines()
        missed = defaultdict(list)
        for (line, column, outcome), count in sorted(branches.items()):
            if not count:
                missed[line].append(f"column {column} never {str(outcome).lower()}")
        for line, outcomes in missed.items():
            text = lines[line - 1].strip()
            reason = next((why for begin, why in REASONS.items() if text.startswith(begin)), "")
            note = reason or ", ".join(outcomes)
            print(f"  {line}: {text[:110]}  -- {note}")


if __name__ == "__main__":
    main(sys.argv[1:])

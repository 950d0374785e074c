"""The same configuration under other circumstances: are the bytes the same?

Usage: .venv/bin/python tests/benchmarks/reproduce.py FOLDER [CONFIG] [CIRCUMSTANCE ...]

Runs CONFIG (config/config.yaml) in copies of the workflow below FOLDER, once as it is and once
under each of the circumstances (all that `CIRCUMSTANCES` names, unless some are named), and prints
the results without durations whose bytes differ. A copy that has been finished is not run again.

With `--compare ONE OTHER` it runs nothing: it compares two folders of results that come from two
machines. Printed are, array by array, the largest difference of each kind of artifact as a share of
the largest value in the array, and by how much the error of each field's force differs. More than
`TOLERANCES` allow is a failure.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from common import ROOT

sys.path.insert(0, str(ROOT / "tests/helpers"))

from pandis.pipeline.run.job.artifact import read_artifact
from support import copy_workflow, environment, results, snakemake_command

#: By which share the mean error of a field's force may differ on another machine: of networks of
#: the paper's loss, which training carries furthest, of other networks, and of all else.
TOLERANCES = {"pandis": 0.25, "pandis-exact": 0.03, "": 1e-3}

#: By name: cores that Snakemake may use, what stands before the command, environment.
CIRCUMSTANCES = {
    "as it is": (2, (), {}),
    "-j1": (1, (), {}),
    "one core": (2, ("taskset", "-c", "0"), {}),
    "one thread each": (2, (), {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}),
    "four threads each, other locale, umask, home and hash seed": (
        2,
        ("sh", "-c", 'umask 077; exec "$@"', "sh"),
        {
            "OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4", "LC_ALL": "C.UTF-8",
            "LANG": "de_DE.UTF-8", "PYTHONHASHSEED": "12345",
        },
    ),
}  # fmt: skip


def run(folder, config, circumstance):
    """Run a configuration in a copy of the workflow under a circumstance; return its results."""
    cores, before, extra = CIRCUMSTANCES[circumstance]
    if not (folder / "results/report.html").is_file():
        if not (folder / "workflow").is_dir():
            copy_workflow(ROOT, folder)
        if extra:
            extra = extra | {"HOME": str(folder / "home")}
            (folder / "home").mkdir(exist_ok=True)
        command = snakemake_command(f"-j{cores}", "all", "--configfile", str(config))
        with (folder / "log").open("w") as log:
            done = subprocess.run(
                [*before, *command], cwd=folder, env=environment(**extra),
                stdout=log, stderr=log, check=False,
            )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"failed: see {folder / 'log'}")
    return results(folder)


def differing(one, other):
    """Return the names of results that are not in both, or not the same in both."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def compare(one, other):
    """Return, by kind of artifact, the largest difference as a share of an array's largest value.

    What has other shapes, or other values that are no numbers, counts as infinitely different.
    """
    worst = {}
    for path in sorted(Path(one).rglob("*.zarr.zip")):
        there = Path(other) / path.relative_to(one)
        if path.name.startswith(("timing", "hardware")) or not there.is_file():
            continue
        kind, pair = (
            path.name.removesuffix(".zarr.zip"),
            (read_artifact(path), read_artifact(there)),
        )
        for name, array in pair[0].arrays.items():
            share = _apart(array, pair[1].arrays.get(name))
            worst[kind] = max(worst.get(kind, (0.0, name)), (share, name))
    return worst


def errors_apart(one, other):
    """Return, by mesh and field, by which share the mean error of the force differs."""
    found = []
    for folder in (one, other):
        with (Path(folder) / "summary.csv").open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row["contact_mean"]]
        found.append({(row["mesh"], row["field"]): float(row["contact_mean"]) for row in rows})
    here, there = found
    return {
        key: abs(here[key] - there[key]) / max(here[key], there[key], 1e-12)
        for key in here.keys() & there.keys()
    }


def judge(one, other):
    """Print what differs between two folders; return whether more does than is allowed."""
    for kind, (share, array) in compare(one, other).items():
        print(f"{kind}: {share:.2g} ({array})")
    failed = False
    for (mesh, field), share in sorted(errors_apart(one, other).items()):
        allowed = TOLERANCES.get(field.split(" ")[0], TOLERANCES[""])
        failed |= share > allowed
        print(f"{mesh} {field}: error {share:.2%} ({allowed:.1%} allowed)")
    return failed


def _apart(one, other):
    if other is None or one.shape != other.shape:
        return np.inf
    if one.dtype.kind not in "fiu":
        return 0.0 if np.array_equal(one, other) else np.inf
    finite = np.isfinite(one)
    if not np.array_equal(finite, np.isfinite(other)):
        return np.inf
    one, other = one[finite].astype(float), other[finite].astype(float)
    return float(np.abs(one - other).max(initial=0) / max(np.abs(one).max(initial=0), 1e-300))


def main(folder, config="config/config.yaml", *circumstances):
    """Run and compare; the exit status tells whether all bytes were the same."""
    folder, first = Path(folder).resolve(), "as it is"
    reference = run(folder / "0", config, first)
    print(f"{len(reference)} results without durations", flush=True)
    bad = False
    for index, name in enumerate(CIRCUMSTANCES):
        if name == first or (circumstances and name not in circumstances):
            continue
        wrong = differing(reference, run(folder / str(index), config, name))
        print(f"{name}: {', '.join(wrong) or 'the same bytes'}", flush=True)
        bad |= bool(wrong)
    return int(bad)


if __name__ == "__main__":
    os.umask(0o022)
    if sys.argv[1:2] == ["--compare"]:
        sys.exit(judge(*sys.argv[2:]))
    else:
        sys.exit(main(*sys.argv[1:]))

"""Mesh files changed at random, read here and by the tests' own counter.

Usage: .venv/bin/python tests/benchmarks/mutations.py [COUNT] [SEED] [THROUGH]

Mutates the small files of tests/helpers/cases.py COUNT times in all (200,000) and reads each in
this process. Of every THROUGH files (200: 1,000 in all), one also goes through the mesh stage.
Printed are files that took longer than the limit, that raised anything but a refusal, that came
out otherwise than the counter says, and how many were read that the counter refuses.
"""

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from common import ROOT

sys.path.insert(0, str(ROOT / "tests/helpers"))

import counter
from cases import CASES, mutations
from pandis.base.errors import PandisError
from pandis.pipeline.mesh.build import build
from pandis.pipeline.mesh.formats import READERS, FormatError, read
from pandis.pipeline.mesh.intake import check_arrays
from pandis.pipeline.run.ask.tasks import MeshTask

#: Seconds that a small file may take.
LIMIT = 2.0


def sources():
    """Yield the ending, the bytes and the companions of every case that is no gzip file."""
    for case in CASES:
        (name, data), *others = case.files.items()
        if not name.endswith(".gz"):
            yield name.rsplit(".", 1)[-1], data, dict(others)


def measured(reading):
    """Return triangles and bounds."""
    corners = reading.vertices[reading.faces]
    return len(reading.faces), corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


def judge(path, form):
    """Return what became of a file, and why."""
    start = time.monotonic()
    try:
        reading = read(path, form)
        check_arrays(reading.vertices, reading.faces)
        outcome, found = "read", measured(reading)
    except FormatError as error:
        outcome, found = "refused", str(error)
    except Exception as error:
        return "raised", repr(error)
    if time.monotonic() - start > LIMIT:
        return "slow", f"{time.monotonic() - start:.1f} s"
    if outcome == "refused":
        return outcome, found
    try:
        wanted = counter.count(path)
    except counter.Refused as error:
        return "read although refused", str(error)
    except Exception as error:
        return "counter raised", repr(error)
    same = found[0] == wanted.triangles and all(
        np.allclose(one, other, rtol=1e-6, atol=1e-9)
        for one, other in zip(found[1:], (wanted.low, wanted.high), strict=True)
    )
    return ("read", "") if same else ("wrong", f"{found} for {wanted}")


def through(path):
    """Run the stage of the mesh; return what it raised but a refusal."""
    options = {"reader_seconds": 20, "rung_seconds": 20}
    task = MeshTask(source=str(path), sha256=None, seed=0, **options)
    start = time.monotonic()
    try:
        build(task, path, lambda text: None)
    except PandisError as error:
        return "defect" if "defect of pandis" in str(error) else "refused", str(error)
    except Exception as error:
        return "raised", repr(error)
    return "built", f"{time.monotonic() - start:.1f} s"


def main(count=200_000, seed=0, whole=1000):
    """Mutate, read, and print what is wrong."""
    known = list(sources())
    rng, tally, seen = np.random.default_rng(seed), Counter(), Counter()
    each = max(1, count // len(known))
    every = max(1, count // max(whole, 1))
    done = 0
    with tempfile.TemporaryDirectory() as folder:
        for form, data, others in known:
            assert form in READERS
            for name, content in others.items():
                (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
                (Path(folder) / name).write_bytes(content)
            path = Path(folder) / f"mutated.{form}"
            for mutated in mutations(data, form, rng, each):
                path.write_bytes(mutated)
                outcome, why = judge(path, form)
                tally[form, outcome] += 1
                bad = outcome not in ("read", "refused")
                if bad and seen[form, outcome] < 20:
                    seen[form, outcome] += 1
                    print(f"{form}: {outcome}: {why[:200]}", flush=True)
                    if outcome != "read although refused":
                        Path(f"mutation-{form}-{done}.{form}").write_bytes(mutated)
                if done % every == 0 and whole:
                    outcome, why = through(path)
                    tally["stage", outcome] += 1
                    if outcome in ("raised", "defect"):
                        print(f"{form}, the whole stage: {outcome}: {why[:300]}", flush=True)
                        Path(f"mutation-{form}-{done}.{form}").write_bytes(mutated)
                done += 1
    for (form, outcome), number in sorted(tally.items()):
        print(f"{form}: {outcome}: {number:,}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""Whether the options that `pandis check` names work; prints a table.

Usage: PANDIS_MESHES=FOLDER .venv/bin/python tests/benchmarks/advice.py [COUNT [FACES]]

Each mesh of PANDIS_MESHES and COUNT variants of them (300 by default, of at most FACES faces,
2,000 by default; see many.py) are checked. A mesh that `check` refuses and for which it names an
option is repaired with that option.
"""

import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

from many import ENDINGS, write_variants

from pandis import check, repair
from pandis.base.errors import PandisError


def outcome(path):
    """Return what `check` says of a mesh, or how its advice fared."""
    try:
        report = check(path)
    except PandisError:
        return "unreadable"
    if report.repair != "refusal":
        return report.repair
    if not report.option:
        return "refusal without an option"
    try:
        repair(path, **report.option)
    except PandisError as error:
        print(f"{path.name}: {report.option}: {error}", flush=True)
        return "option failed"
    return "option worked"


def main():
    count, faces = (*map(int, sys.argv[1:]), *(300, 2000)[len(sys.argv) - 1 :])
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "config").mkdir()
        write_variants(Path(name), count, faces)
        shared = Path(os.environ["PANDIS_MESHES"]).rglob("*")
        paths = [p for p in sorted(shared) if p.suffix.lower() in ENDINGS]
        paths += [p for p in sorted(Path(name, "meshes").iterdir()) if p.stem.startswith("m")]
        outcomes = Counter()
        for done, path in enumerate(paths, 1):
            outcomes[outcome(path)] += 1
            if done % 20 == 0:
                print(f"{done} of {len(paths)}: {dict(outcomes)}", file=sys.stderr, flush=True)
    for what, number in outcomes.most_common():
        print(f"{number:5}  {what}")


if __name__ == "__main__":
    main()

"""How long planning takes: a dry run over many meshes, and a run with nothing to do.

    .venv/bin/python tests/benchmarks/planning.py [folder of a finished run]

Prints seconds: the median of three. The bars: 50 meshes in 8 s, 300 in 45 s, nothing to do in 6 s.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/helpers"), str(ROOT / "workflow")]

from support import copy_workflow, snakemake_command  # noqa: E402


def seconds(folder, *arguments):
    """Return the median time of three calls."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        done = subprocess.run(
            snakemake_command(*arguments), cwd=folder, capture_output=True, text=True, check=False
        )
        times.append(time.perf_counter() - start)
        if done.returncode:
            sys.exit(done.stdout + done.stderr)
    return statistics.median(times)


def main():
    """Print the table."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = copy_workflow(ROOT, Path(temporary) / "copy")
        for count in (50, 300):
            meshes = {f"mesh-{i}": {"source": "analytic:sphere"} for i in range(count)}
            path = folder / "config" / "many.yaml"
            path.write_text(yaml.safe_dump({"meshes": meshes}))
            arguments = ("-n", "-q", "--configfile", "config/many.yaml")
            print(f"dry run, {count} meshes, default fields: {seconds(folder, *arguments):.1f} s")
    if len(sys.argv) > 1:
        print(f"nothing to do: {seconds(sys.argv[1], '-j2', 'all'):.1f} s")


if __name__ == "__main__":
    main()

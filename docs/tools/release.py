"""Build the files of a release in dist/, check them, and run README's programs with them.

Usage: make release
The files are the wheel, the source distribution and the joined ``pandis.h``. Twine checks the first
two. A wheel built from the source distribution must contain the same files as the one built here.
README's programs run in an empty environment where only the wheel is installed, and are compiled
against the header in dist/. Nothing is uploaded.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DIST = ROOT / "dist"
HEADER = ROOT / "workflow/pandis/engine/pandis.h"


def environment(folder, *packages):
    """Create an environment with packages; return its Python."""
    venv.create(folder, with_pip=True)
    python = folder / "bin/python"
    run(python, "-m", "pip", "install", "-q", *packages)
    return python


def run(*command, **extra):
    """Run a command in the repository; exit with a message if it fails."""
    print("$", *command, flush=True)
    # PYTHONPATH would make this checkout precede the installed package
    shell = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(list(map(str, command)), cwd=ROOT, env=shell | extra, check=False)
    if done.returncode:
        sys.exit(f"error: this command of the release failed: {' '.join(map(str, command))}")


def files_of(wheel):
    """Return the names and checksums of a wheel's files, except its RECORD."""
    with zipfile.ZipFile(wheel) as archive:
        infos = [info for info in archive.infolist() if not info.filename.endswith("RECORD")]
    return {info.filename: info.CRC for info in infos}


def main():
    """Build, check and test a release."""
    clean(DIST)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        tools = environment(folder / "tools", "-r", Path(__file__).with_suffix(".txt"))
        for target in ("--sdist", "--wheel"):
            run(tools, "-m", "build", target, "--outdir", DIST)
        clean()
        (source,), (wheel,) = DIST.glob("*.tar.gz"), DIST.glob("*.whl")
        run(tools, "-m", "build", "--wheel", "--outdir", folder / "again", unpacked(source, folder))
        (again,) = (folder / "again").glob("*.whl")
        if files_of(again) != files_of(wheel):
            other = sorted(set(files_of(again).items()) ^ set(files_of(wheel).items()))
            sys.exit(f"error: a wheel from {source.name} differs from {wheel.name}: {other[:5]}")
        run(tools, "-m", "twine", "check", "--strict", source, wheel)
        shutil.copy(HEADER, DIST)
        empty = environment(folder / "empty", wheel)
        test = "tests/workflow/test_readme.py"
        run(sys.executable, "-m", "pytest", "-m", "", "-q", test,
            PANDIS_PYTHON=str(empty), PANDIS_HEADER=str(DIST))  # fmt: skip
    print("dist/ contains", *sorted(path.name for path in DIST.iterdir()))


def clean(*folders):
    """Remove a build's leftovers from the sources, because the next build would pack them."""
    for folder in (ROOT / "build", *(ROOT / "workflow").glob("*.egg-info"), *folders):
        shutil.rmtree(folder, ignore_errors=True)


def unpacked(source, folder):
    """Unpack the source distribution; return its folder."""
    shutil.unpack_archive(source, folder / "source", filter="data")
    (inside,) = (folder / "source").iterdir()
    return inside


if __name__ == "__main__":
    main()

"""Compiles sources once per machine, and loads C libraries."""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.engine import prebuilt
from pandis.engine.cache import cache_folder
from pandis.engine.sources import included

#: Reassociation and fused multiply-add are off, so results do not depend on the machine. Errno and
#: traps are off, so the compiler can vectorise.
FLAGS = (
    "-std=c99",
    "-O3",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fPIC",
    "-shared",
)


def find_compiler():
    """Return the C compiler to use, or None if there is none."""
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    return compiler if compiler and shutil.which(compiler) else None


@cache
def load(source):
    """Load a C file as a library: see `compiled`."""
    return ctypes.CDLL(str(compiled(source)))


def compiled(source, headers=()):
    """Return the path of a C file's library, which is prebuilt, cached or compiled now.

    Parameters
    ----------
    source : Path
    headers : sequence of Path
        Folders with headers of other projects that the source includes.

    Returns
    -------
    Path

    Raises
    ------
    PandisError
        There is no compiler, or it fails.
    """
    if ready := prebuilt.find(source, FLAGS):
        return ready
    compiler = find_compiler()
    if compiler is None:
        raise PandisError(
            f"no C compiler found for {source.name}: install one (Debian: apt-get install gcc; "
            "conda: conda install gcc) or name it in the environment variable CC"
        )
    command = [compiler, "-march=native", *FLAGS, *(f"-I{folder}" for folder in headers)]
    return build(command, source, ["-lm", "-ldl", "-lpthread"], name=f"{source.stem}.so")


def prebuild(folder, headers):
    """Compile the libraries that the package ships (`pandis.engine.prebuilt`) into a folder.

    Parameters
    ----------
    folder : Path
    headers : dict of str to Path
        For each library, the folder of the other project's headers that it needs. Libraries that
        need such headers but have no entry are left out.

    Returns
    -------
    list of Path

    Raises
    ------
    PandisError
        There is no compiler, or it fails.
    """
    compiler, machine, paths = find_compiler(), platform.machine(), []
    if compiler is None:
        raise PandisError("no C compiler found: install gcc, or set the environment variable CC")
    if machine not in prebuilt.KINDS:
        raise PandisError(f"no libraries are built for machines of type {machine}")
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "together.c"
        for library in prebuilt.LIBRARIES.keys() - (prebuilt.FOREIGN - headers.keys()):
            source.write_text(prebuilt.together(library), encoding="utf-8")
            others = [f"-I{headers[library]}"] if library in headers else []
            kind = prebuilt.KINDS[machine]
            path = Path(folder) / prebuilt.name(library, FLAGS, kind)
            command = [compiler, f"-march={kind}", *FLAGS, *prebuilt.SMALLER, *others, str(source)]
            paths.append(_compile([*command, "-lm"], path))
    return paths


def build(command, source, libraries, *, name):
    """Compile a source once per machine, and cache the result.

    Parameters
    ----------
    command : list of str
        The compiler and its flags.
    source : Path
    libraries : list of str
        Flags that follow the source in the command.
    name : str
        Name of the output file; a digest of all its inputs is inserted before the suffix.

    Returns
    -------
    Path

    Raises
    ------
    PandisError
        The compiler fails.
    """
    texts = [path.read_text("utf-8") for path in included(source)]
    # code compiled for one processor may not run on another
    key = [*command, *libraries, platform.machine(), prebuilt.processor(), *texts]
    digest = hashlib.sha256("\0".join(key).encode()).hexdigest()[:20]
    compiled = cache_folder() / f"{Path(name).stem}-{digest}{Path(name).suffix}"
    if compiled.is_file():
        return compiled
    if sys.stderr.isatty():
        print(f"pandis: compiling {source.name}, once on this machine …", file=sys.stderr)
    return _compile([*command, str(source), *libraries], compiled)


def _compile(command, compiled):
    """Compile to a path, or to a temporary folder if that path is not writable; return the path."""
    try:
        compiled.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(dir=compiled.parent)
    except OSError:
        folder = tempfile.mkdtemp(prefix="pandis-")
        compiled = Path(folder) / compiled.name
    part = Path(folder) / "part"
    done = subprocess.run([*command, "-o", str(part)], capture_output=True, text=True, check=False)
    if done.returncode:
        shutil.rmtree(folder, ignore_errors=True)
        raise PandisError(f"{' '.join(command)} failed:\n{done.stderr.strip()}")
    part.replace(compiled)  # atomic, even if another process compiles the same file
    if Path(folder) != compiled.parent:
        shutil.rmtree(folder, ignore_errors=True)
    return compiled

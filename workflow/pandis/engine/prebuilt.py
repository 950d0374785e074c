"""Finds the compiled libraries that the package ships, so that querying fields needs no compiler.

They are built with the package. A checkout has none and compiles each source on first use.
"""

import hashlib
import platform
from functools import cache
from pathlib import Path

from pandis.engine.sources import included

_PACKAGE = Path(__file__).parents[1]
FOLDER = _PACKAGE / "engine/built"
#: Sources of each library: one library for fields, contacts and scenes, and one per plugin.
LIBRARIES = {
    "pandis": [
        _PACKAGE / "runtime/field/field.c",
        _PACKAGE / "runtime/contact/contact.c",
        _PACKAGE / "runtime/scene/scene.c",
    ],
    "pandis-mujoco": [_PACKAGE / "bridges/mujoco/plugin.c"],
}
#: Libraries that need another project's headers: built only where those headers are found.
FOREIGN = {"pandis-mujoco"}
#: For each architecture, the compiler's name for the oldest supported processor. Hot loops are also
#: compiled for AVX2; which version runs is decided at run time. Both give identical results.
KINDS = {"x86_64": "x86-64", "aarch64": "armv8-a"}
#: Omitting unwind tables (C code throws no exceptions) makes libraries a twentieth smaller.
#: Unrolling only short loops makes them another seventh smaller, and no slower.
SMALLER = ("-fno-asynchronous-unwind-tables", "-fno-unwind-tables", "-fno-align-functions",
           "-fno-align-loops", "-fno-align-jumps", "-fno-plt",
           "--param=max-completely-peeled-insns=80", "-Wl,-z,noseparate-code",
           "-Wl,--build-id=none", "-s")  # fmt: skip


def find(source, flags):
    """Return the prebuilt library that contains a source and runs on this processor, or None.

    Parameters
    ----------
    source : Path
    flags : sequence of str
        Compiler flags that the library was built with, except for the processor's name.
    """
    library = next((key for key, parts in LIBRARIES.items() if source in parts), None)
    if library is None or not FOLDER.is_dir() or platform.machine() not in KINDS:
        return None
    path = FOLDER / name(library, flags, KINDS[platform.machine()])
    return path if path.is_file() else None


@cache
def name(library, flags, kind):
    """Return a library's file name, which contains a digest of its flags and sources."""
    files = dict.fromkeys(path for part in LIBRARIES[library] for path in included(part))
    texts = [path.read_text("utf-8") for path in files]
    digest = hashlib.sha256("\0".join([*flags, *texts]).encode()).hexdigest()[:12]
    return f"{library}-{kind}-{digest}.so"


def together(library):
    """Return C source that includes all parts of a library."""
    heads = ["#define _POSIX_C_SOURCE 199309L", "#define PANDIS_IMPLEMENTATION"]
    return "\n".join([*heads, *(f'#include "{part}"' for part in LIBRARIES[library])]) + "\n"


@cache
def processor():
    """Return the processor's features as listed by the system, or its name if there is no list."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")

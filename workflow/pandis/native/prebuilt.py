"""The library that a package brings along, compiled: who only asks fields needs no compiler.

It is made when the package is built. A checkout has none, and compiles each source on first use.
"""

import hashlib
import platform
from functools import cache
from pathlib import Path

from pandis.native.sources import included

_HERE = Path(__file__).parent
FOLDER = _HERE / "built"
#: What fields, contacts and scenes are asked through, each once in the library.
PARTS = [_HERE / part for part in ("runtime/runtime.c", "contact/contact.c", "scene/scene.c")]
#: By machine: kinds of processors, the ablest first, with the compiler's name for each, and what
#: the system has to say of a processor that is one. Answers are the same to the last bit.
KINDS = {
    "x86_64": {
        "x86-64-v3": {"avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"},
        "x86-64": set(),
    },
    "aarch64": {"armv8-a": set()},
}


def find(source, flags):
    """Return the library that runs on this processor and holds a source, None if there is none.

    Parameters
    ----------
    source : Path
    flags : sequence of str
        It was compiled with, beside the kind of processor.
    """
    if source not in PARTS or not FOLDER.is_dir():
        return None
    kinds = KINDS.get(platform.machine(), {})
    able = (kind for kind, needs in kinds.items() if needs <= abilities())
    made = (FOLDER / name(flags, kind) for kind in able)
    return next((path for path in made if path.is_file()), None)


@cache
def name(flags, kind):
    """Return what the library is called: that of other sources has another name."""
    files = dict.fromkeys(path for part in PARTS for path in included(part))
    texts = [path.read_text("utf-8") for path in files]
    digest = hashlib.sha256("\0".join([*flags, *texts]).encode()).hexdigest()[:12]
    return f"pandis-{kind}-{digest}.so"


def together():
    """Return the text in C that holds all parts."""
    heads = ["#define _POSIX_C_SOURCE 199309L", "#define PANDIS_IMPLEMENTATION"]
    return "\n".join([*heads, *(f'#include "{part}"' for part in PARTS)]) + "\n"


@cache
def processor():
    """Return the line in which the system says what its processor can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


def abilities():
    """Return what the processor can do, word by word."""
    return frozenset(processor().partition(":")[2].split())

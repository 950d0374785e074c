"""Compile web.c into pandis.wasm, which web pages run. Repeat it after a change of pandis.h.

Usage: make wasm

Needs clang with the target wasm32, and wasm-ld: Debian's packages clang and lld.
"""

import subprocess
import sys
from pathlib import Path

from pandis.bridges.web import HERE, MODULE, SOURCE
from pandis.engine.sources import digest

EXPORTS = "numbers", "room", "open", "error", "begin", "ticks", "query", "digest"
FLAGS = (
    *("--target=wasm32", "-Oz", "-msimd128", "-mbulk-memory", "-ffreestanding", "-nostdlib"),
    *("-ffp-contract=off", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror"),
    *("-Wl,--no-entry", "-Wl,--allow-undefined", "-Wl,-z,stack-size=524288", "-Wl,--strip-all"),
    *(f"-Wl,--export=web_{name}" for name in EXPORTS),
)


def build(target):
    """Compile the module, and write it to a path."""
    define = f'-DWEB_DIGEST="{digest(SOURCE)}"'
    command = ["clang", *FLAGS, define, "-I", str(HERE / "libc"), str(SOURCE), "-o"]
    subprocess.run([*command, str(target)], check=True)


if __name__ == "__main__":
    module = Path(sys.argv[1]) if len(sys.argv) > 1 else MODULE
    build(module)
    print(f"wrote {module}: {module.stat().st_size:,} bytes")

"""Fields in C#: writes the files that Unity, .NET and Mono need."""

from os import PathLike
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.base.files import write_atomically
from pandis.engine.compiler import FLAGS, build, find_compiler

_HERE = Path(__file__).parent
SOURCE = _HERE / "pandis.c"
#: Names of the files that `write_csharp` writes.
FILES = ("Pandis.cs", "libpandis.so")


def write_csharp(folder: str | PathLike[str]) -> list[Path]:
    """Write ``Pandis.cs``, and the native library that it calls, into a folder.

    The library runs on machines with this architecture and operating system. For others, compile
    ``pandis.c`` there into a shared library called ``pandis``.

    Parameters
    ----------
    folder : path-like
        ``Assets/Plugins`` for Unity; created if necessary.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    PandisError
        There is no compiler.
    """
    compiler = find_compiler()
    if compiler is None:
        raise PandisError("no C compiler found: install gcc, or set the environment variable CC")
    library = build([compiler, *FLAGS, "-s"], SOURCE, ["-lm"], name="csharp.so")
    folder = Path(folder)
    written = [folder / name for name in FILES]
    for path, source in zip(written, (_HERE / "Pandis.cs", library), strict=True):
        write_atomically(path, source.read_bytes())
    return written

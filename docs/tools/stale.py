"""Print the stages that an edit of a file can make stale.

Usage: PYTHONPATH=workflow .venv/bin/python docs/tools/stale.py FILE...
FILE is a module, a script or a C source. Edits of comments, docstrings and layout make nothing
stale. An edit of a loss counts only for recipes with that loss. An edit of one of the paper's other
methods counts only for meshes that use it.
"""

import sys
from pathlib import Path

from pandis.engine.sources import included
from pandis.pipeline.run.job.provenance import CodeDigests

ROOT = Path(__file__).resolve().parents[2]


def stages_by_file(root=ROOT):
    """Return the names of the stages that use each file, as a dict of path to set."""
    code, stages = CodeDigests(root / "workflow"), {}
    for script in sorted(code.scripts.glob("*.py")):
        stages.setdefault(script.resolve(), set()).add(script.stem)
        for module in code.modules(script.stem):
            if module.startswith("pandis."):
                for path in _files(root / "workflow", module):
                    stages.setdefault(path.resolve(), set()).add(script.stem)
    engine = (root / "workflow/pandis/engine").resolve()
    for part in (engine / "parts").glob("*.h"):  # pandis.h is joined from these
        stages.setdefault(part, set()).update(stages[engine / "pandis.h"])
    return stages


def _files(root, module):
    """Yield a module's files; those of a package include templates and C sources."""
    path = root.joinpath(*module.split("."))
    if not path.is_dir():
        yield path.with_suffix(".py")
        return
    yield path / "__init__.py"
    for file in path.iterdir():
        if file.suffix in (".html", ".css", ".js"):
            yield file
        if file.suffix in (".c", ".cpp"):
            yield from included(file)


def main(paths):
    """Print a line for each file; return whether one is missing."""
    stages, missing = stages_by_file(), False
    for path in paths:
        if not Path(path).is_file():
            print(f"{path}: no such file", file=sys.stderr)
            missing = True
            continue
        names = stages.get(Path(path).resolve(), ())
        print(f"{path}: {', '.join(sorted(names)) or 'nothing'}")
    return missing


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))

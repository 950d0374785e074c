"""Provenance of a result: the code, options, inputs and versions that made it.

Snakemake tracks a script by its modification time, and an imported module not
at all. Here every rule gets a ``code`` param instead: a digest of its script
and of all library modules that it imports, directly or indirectly, C included.
Comments, docstrings, annotations of signatures and formatting do not count.
The digests are stored inside each artifact, together with its options, inputs
and versions, so that `verify` needs only the folder of results.
"""

import ast
import hashlib
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from pandis.engine.cache import remembered
from pandis.engine.compiler import find_compiler
from pandis.engine.sources import digest as source_digest
from pandis.pipeline.run.ask.catalogue import known_field
from pandis.pipeline.run.ask.kind import AUTO
from pandis.pipeline.run.ask.kinds import KINDS

#: Suffixes of files that belong to a package besides its modules: templates, and C sources, which
#: are digested together with the files they include.
_DATA, _SOURCES = {".html", ".css", ".js"}, {".c", ".cpp"}

#: Distribution names of packages that are imported under another name.
DISTRIBUTIONS = {
    "igl": "libigl", "mujoco": "mujoco-core", "yaml": "PyYAML", "skimage": "scikit-image",
    "warp": "warp-lang",
}  # fmt: skip
#: Packages whose versions do not count: pandis itself, which is digested, and those that do not
#: affect results.
_NOTHING = {"pandis", "snakemake", "jaxtyping", ""}
#: Python is recorded as major.minor: patch releases do not change results.
_PYTHON = "python"


#: Models of options are not digested. They only name and check values; the values themselves reach
#: a stage as its options, which are compared.
_MODELS = tuple(
    f"pandis.pipeline.run.ask.{name}"
    for name in ("options", "recipes", "targets", "tasks", "values")
)


#: Kinds that ``fields: auto`` may choose.
_CHOSEN = tuple(name for name, kind in KINDS.items() if kind.chosen)


class Needs(NamedTuple):
    """The parts of a stage's code that its options require.

    Attributes
    ----------
    kinds : tuple of str
        Kinds of fields whose modules the stage loads: `pandis.pipeline.run.ask.kinds.kind_module`.
    unused : tuple of str
        Modules that the stage imports but never runs.
    """

    kinds: tuple[str, ...] = tuple(KINDS)
    unused: tuple[str, ...] = ()


#: Default needs of a stage: all kinds, and every module that it imports.
EVERYTHING = Needs()


def needs(options):
    """Return the `Needs` of a stage with these options.

    The result excludes kinds without a field in the stage, the size search if the size is
    given, and modules that the kinds report as unused.
    """
    kinds, unused = _kinds(options), []
    if options.get("kind") in KINDS and "target" not in options:
        unused = [f"pandis.pipeline.kinds.{kind}.search" for kind in kinds]
    for kind in kinds:
        unused += KINDS[kind].unused(options)
    if not options.get("builds", True):
        unused.append("pandis.pipeline.dataset.fields")
    return Needs(kinds, tuple(unused))


def _kinds(options):
    """Return the kinds of fields that a stage builds, exports, or queries without their files."""
    if options.get("kind") in KINDS:
        return (options["kind"],)
    specs = []
    if "field" in options:
        specs = [known_field(options["field"])]
    elif "builds" in options:
        specs = [known_field(name) for name in options["builds"]]
    elif "fields" not in options and "in_python" not in options:
        return _CHOSEN
    for key in ("fields", "in_python"):
        value = options.get(key, ())
        lists = value.values() if isinstance(value, dict) else [value]
        names = [name for names in lists for name in names]
        # a field with an exported file is queried through that file
        specs += [s for s in map(known_field, names) if not s.native]
    specs += [spec.through for spec in specs if spec.through]
    if any(spec.kind == AUTO for spec in specs):
        return _CHOSEN
    return tuple(kind for kind in KINDS if any(spec.kind == kind for spec in specs))


class CodeDigests:
    """Digests of scripts and of the library modules that they import.

    Parameters
    ----------
    folder : path-like
        The Snakefile's folder. The scripts are in ``folder/../scripts``.

    Attributes
    ----------
    root : Path
        The folder that contains the package ``pandis``. In a checkout this is the Snakefile's
        folder; in an installation the Snakefile is inside the package.
    """

    def __init__(self, folder):
        folder = self.folder = Path(folder)
        self.root = folder if (folder / "pandis").is_dir() else folder.parents[2]
        self.scripts = folder.parent / "scripts"
        self._digests = {}
        self._imports, self._parts, self._resolved = {}, {}, {}
        self._packages, self._versions = {}, {}

    def stage(self, name, needs=EVERYTHING):
        """Return one digest (hex) for the stage whose script is ``{name}.py``."""
        return combine(self.modules(name, needs))

    def modules(self, name, needs=EVERYTHING):
        """Return what a stage's code depends on: a sorted dict of name to digest or version."""
        script = f"scripts/{name}"
        self._load(script, self.scripts / f"{name}.py", package="")
        seen, queue = set(needs.unused), [script]
        while queue:
            module = queue.pop()
            if module not in seen:
                seen.add(module)
                queue += self._imports[module]
                for part in self._parts[module]:
                    for kind in needs.kinds:
                        queue += self._resolve(f"pandis.pipeline.kinds.{kind}.{part}")
        modules = {module: self._digests[module] for module in sorted(seen - set(needs.unused))}
        packages = {name for module in modules for name in self._packages[module]}
        versions = {f"package {name}": self._version(name) for name in sorted(packages)}
        major, minor = sys.version_info[:2]
        return modules | versions | {_PYTHON: f"{major}.{minor}"}

    def _version(self, name):
        if name not in self._versions:
            self._versions[name] = package_version(name)
        return self._versions[name]

    def _load(self, module, path, package):
        if module in self._digests:
            return
        facts = _facts(path.read_bytes(), package)
        self._digests[module] = facts["digest"]
        imports = self._imports[module] = []
        self._packages[module] = set(facts["packages"])
        self._parts[module] = facts["parts"]
        if path.name == "__init__.py":
            # templates and sources belong to the package whose folder they are in
            files = [f for f in path.parent.iterdir() if not f.name.startswith(".")]
            digests = {
                f.name: hashlib.sha256(f.read_bytes()).hexdigest()
                for f in files
                if f.suffix in _DATA
            }
            digests |= {f.name: source_digest(f) for f in files if f.suffix in _SOURCES}
            if digests:
                self._digests[module] = combine({"": self._digests[module]} | digests)
        for name in facts["imports"]:
            imports += self._resolve(name)

    def _resolve(self, name):
        """Return the modules that ``import name`` runs: the module and its packages.

        The list omits the models of options. It also omits ``pandis`` itself, which contains only
        the version and an entry point for users, because no stage runs it.
        """
        if name in self._resolved:
            return self._resolved[name]
        if name.startswith(_MODELS):
            return []
        parts, modules = name.split("."), []
        for depth in range(2, len(parts) + 1):
            base = self.root.joinpath(*parts[:depth])
            module = ".".join(parts[:depth])
            if (base / "__init__.py").is_file():
                self._load(module, base / "__init__.py", package=module)
            elif base.with_suffix(".py").is_file():
                self._load(module, base.with_suffix(".py"), package=".".join(parts[: depth - 1]))
            else:
                break  # a name inside the module, or not one of our modules
            modules.append(module)
        self._resolved[name] = modules
        return modules


def package_version(name):
    """Return the version of an imported package; ``absent`` if it is not installed."""
    try:
        return metadata.version(DISTRIBUTIONS.get(name, name))
    except metadata.PackageNotFoundError:
        return "absent"


def combine(digests):
    """Return one digest for a dict of name to digest."""
    text = "\n".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()


def _facts(source, package):
    """Return a module's digest, its imports of ``pandis``, and its third-party packages.

    Parsing would take a third of a second per stage in every job and every planning run, so the
    facts are stored in the user's cache under the digest of the text.
    """

    def facts():
        tree = ast.parse(source)
        return {
            "digest": _tree_digest(tree),
            "imports": list(_imported(tree, package)),
            "packages": sorted(set(_foreign(tree))),
            "parts": sorted(set(_parts(tree))),
        }

    return remembered(__file__, source + b"\0" + package.encode(), facts)


def _tree_digest(tree):
    """Digest the code: unparsed source without comments, docstrings and annotations.

    `ast.unparse` gives the same text on Python 3.11 to 3.13; `ast.dump` does not.
    """
    for node in ast.walk(tree):
        documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:] or [ast.Pass()]
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.returns = None
        if isinstance(node, ast.arg):
            node.annotation = None
    return hashlib.sha256(ast.unparse(tree).encode()).hexdigest()


def _imported(tree, package):
    """Yield the dotted names of ``pandis`` that a module imports, anywhere in its code."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base]).strip(".")
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "pandis")


def _parts(tree):
    """Yield the names of kinds' modules that a module loads: second arguments of `kind_module`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "kind_module":
            yield node.args[1].value


def _foreign(tree):
    """Yield the names of third-party packages that a module imports, anywhere in its code."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module or ""]
        else:
            continue
        tops = {name.split(".")[0] for name in names}
        yield from tops - _NOTHING - sys.stdlib_module_names


def versions(modules):
    """Return the versions of Python, of the packages that a stage imports, and of the C compiler.

    A different compiler makes nothing stale, because it gives the same bits.

    Parameters
    ----------
    modules : dict of str to str
        From `CodeDigests.modules`.
    """
    versions = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name, version in modules.items():
        if name.startswith("package "):
            versions[name.removeprefix("package ")] = version
    if "pandis.engine.compiler" in modules:
        versions["compiler"] = compiler_version()
    return versions


@cache
def compiler_version():
    """Return the version line of the C compiler; empty if there is none."""
    compiler = find_compiler()
    if compiler is None:
        return ""
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return done.stdout.partition("\n")[0]


def provenance(stage, wildcards, options, *, modules, inputs):
    """Assemble an artifact's provenance. It excludes the time, the host and the machine's paths.

    Parameters
    ----------
    stage : str
        Name of the rule, and of its script.
    wildcards : dict of str to str
        Values of the wildcards, which tell this output from the stage's other outputs.
    options : dict
        Options of the job.
    modules : dict of str to str
        Digests of modules and versions of packages, from `CodeDigests.modules`.
    inputs : dict of str to str
        Content digest of each input file, by its path relative to the working directory. In paths,
        `pandis.pipeline.run.job.stored.RESULTS` stands for the results folder.
    """
    return {
        "stage": stage,
        "wildcards": wildcards,
        "options": options,
        "code": {"digest": combine(modules), "modules": modules},
        "inputs": inputs,
        "versions": versions(modules),
    }

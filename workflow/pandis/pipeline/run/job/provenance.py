"""Why a result is current: the code, options, inputs and versions that made it.

Snakemake tracks a script by its modification time and an imported module not
at all. Here every rule gets a ``code`` param instead: a digest of its script
and of all library modules that it imports, directly or through others, C included.
Comments, docstrings, annotations of signatures and formatting do not count. The
same facts are stored inside each artifact, so that `verify` can judge a folder of
results alone.
"""

import ast
import hashlib
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path

from pandis.engine.cache import remembered
from pandis.engine.compiler import find_compiler
from pandis.engine.sources import digest as source_digest

#: Files beside a package's modules that are a part of it: templates; sources in C, and with them
#: what they include.
_DATA, _SOURCES = {".html", ".css", ".js"}, {".c", ".cpp"}

#: Packages that are installed under another name than they are imported by.
DISTRIBUTIONS = {
    "igl": "libigl", "mujoco": "mujoco-core", "yaml": "PyYAML", "skimage": "scikit-image",
    "warp": "warp-lang",
}  # fmt: skip
#: What does nothing to a result: ourselves, who are digested, and what only names shapes.
_NOTHING = {"pandis", "snakemake", "jaxtyping", ""}
#: Python is recorded as major.minor: patch releases do not change results.
_PYTHON = "python"


#: Modules that one kind of recipe alone runs, though the trainer imports them all.
_LOSSES = {
    "paper": "pandis.pipeline.kinds.network.training.paper_loss",
    "exact": "pandis.pipeline.kinds.network.training.exact_loss",
}


#: Modules that only a training on a GPU runs.
ON_GPUS = ("pandis.pipeline.kinds.network.training.labels", "pandis.engine.cuda.steps")


#: Modules of the paper's other methods, and how the names of their fields begin.
_METHODS = {
    "pandis.pipeline.kinds.grid.implicit": "kim-",
    "pandis.pipeline.kinds.paper.planes": "support-planes",
    "pandis.pipeline.kinds.paper.proxy": "salisbury",
}


#: Models of options: they name and check values, and what they let through reaches a stage as its
#: options, which are compared themselves.
_MODELS = tuple(
    f"pandis.pipeline.run.ask.{name}" for name in ("options", "recipes", "tasks", "values")
)


def unused_modules(options):
    """Return the modules that a stage imports but, with these options, never runs.

    Of the two losses the other one's; what serves a GPU where a CPU trains; and those of methods
    that none of its fields is of.
    """
    trained = options.get("recipe", {})
    losses = [m for loss, m in _LOSSES.items() if trained.get("loss", loss) != loss]
    names = tuple(_field_names(options))
    methods = [m for m, start in _METHODS.items() if not any(n.startswith(start) for n in names)]
    on_cpu = trained.get("device", "cpu") == "cpu"
    return (*losses, *methods, *(ON_GPUS if on_cpu else []))


def _field_names(options):
    """Yield the names of fields, and of a kind of them, among the options of any stage."""
    for key in ("fields", "field", "in_python", "kind"):
        value = options.get(key, ())
        lists = value.values() if isinstance(value, dict) else [value]
        for names in lists:
            # the one kind of a stage that sizes grids stands for their names
            yield from [f"{names}-"] if isinstance(names, str) else names


class CodeDigests:
    """Digests of scripts and of the library modules behind them.

    Parameters
    ----------
    root : path-like
        The folder that holds the package ``pandis`` (``workflow/``).
    scripts : path-like, optional
        The folder of the scripts; ``root/../scripts`` by default.
    """

    def __init__(self, root, scripts=None):
        self.root = Path(root)
        self.scripts = Path(scripts) if scripts else self.root.parent / "scripts"
        self._own = {}
        self._imports = {}
        self._packages, self._versions = {}, {}

    def stage(self, name, unused=()):
        """Return one digest (hex) for the stage whose script is ``{name}.py``."""
        return combine(self.modules(name, unused))

    def modules(self, name, unused=()):
        """Return the digest of each file behind a stage, as a sorted dict of name to hex.

        ``unused`` names modules to leave out: see `unused_modules`.
        """
        script = f"scripts/{name}"
        self._load(script, self.scripts / f"{name}.py", package="")
        seen, queue = set(unused), [script]
        while queue:
            module = queue.pop()
            if module not in seen:
                seen.add(module)
                queue += self._imports[module]
        modules = {module: self._own[module] for module in sorted(seen - set(unused))}
        packages = {name for module in modules for name in self._packages[module]}
        versions = {f"package {name}": self._version(name) for name in sorted(packages)}
        major, minor = sys.version_info[:2]
        return modules | versions | {_PYTHON: f"{major}.{minor}"}

    def _version(self, name):
        if name not in self._versions:
            self._versions[name] = package_version(name)
        return self._versions[name]

    def _load(self, module, path, package):
        if module in self._own:
            return
        facts = _facts(path.read_bytes(), package)
        self._own[module] = facts["digest"]
        imports = self._imports[module] = []
        self._packages[module] = set(facts["packages"])
        if path.name == "__init__.py":
            # templates and the like belong to the package they lie in
            files = [f for f in path.parent.iterdir() if not f.name.startswith(".")]
            digests = {
                f.name: hashlib.sha256(f.read_bytes()).hexdigest()
                for f in files
                if f.suffix in _DATA
            }
            digests |= {f.name: source_digest(f) for f in files if f.suffix in _SOURCES}
            if digests:
                self._own[module] = combine({"": self._own[module]} | digests)
        for name in facts["imports"]:
            imports += self._resolve(name)

    def _resolve(self, name):
        """Return the modules that ``import name`` runs: the module and its packages.

        But for ``pandis`` itself, which holds the version and a way in for users, and nothing that
        a stage runs; and for the models of options.
        """
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
                break  # a name inside the module, or no module of ours
            modules.append(module)
        return modules


def package_version(name):
    """Return the version of what ``import name`` imports; ``absent`` if it is not installed."""
    try:
        return metadata.version(DISTRIBUTIONS.get(name, name))
    except metadata.PackageNotFoundError:
        return "absent"


def combine(digests):
    """Return one digest for a dict of name to digest."""
    text = "\n".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()


def _facts(source, package):
    """Return the digest of a module's source, its imports of ``pandis``, and others' packages.

    Parsing takes a third of a second for a stage, in every job and at every planning: what is known
    of a text is kept in the user's cache, under the text's digest.
    """

    def facts():
        tree = ast.parse(source)
        return {
            "digest": _tree_digest(tree),
            "imports": list(_imported(tree, package)),
            "packages": sorted(set(_foreign(tree))),
        }

    return remembered(__file__, source + b"\0" + package.encode(), facts)


def _tree_digest(tree):
    """Digest what the code does: unparsed source without comments, docstrings, and annotations.

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
    """Yield the dotted names of ``pandis`` that a module imports, wherever it does."""
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


def _foreign(tree):
    """Yield the names of the packages of others that a module imports, wherever it does."""
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
    """Return the versions behind a stage: Python, the packages it imports, the C compiler.

    The compiler makes nothing stale: another one gives the same bits.

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
    """Return what the C compiler calls itself; an empty text without one."""
    compiler = find_compiler()
    if compiler is None:
        return ""
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return done.stdout.partition("\n")[0]


def provenance(stage, wildcards, options, modules, inputs):
    """Assemble an artifact's provenance. It holds no time, host or path of the machine.

    Parameters
    ----------
    stage : str
        Name of the rule and its script.
    wildcards : dict of str to str
        Which of the stage's outputs this is.
    options : dict
        The options that the stage was given.
    modules : dict of str to str
        From `CodeDigests.modules`.
    inputs : dict of str to str
        Content digest of each input file, by its path relative to the working directory; below the
        folder of results it begins with `pandis.pipeline.run.job.stored.RESULTS`.
    """
    return {
        "stage": stage,
        "wildcards": wildcards,
        "options": options,
        "code": {"digest": combine(modules), "modules": modules},
        "inputs": inputs,
        "versions": versions(modules),
    }

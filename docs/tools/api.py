"""Generate the API pages from the docstrings and from the header's comments."""

import inspect
import re
from pathlib import Path

import pandis

ROOT = Path(__file__).resolve().parents[2]
PYTHON, MESHES, C = (ROOT / f"docs/api/{name}.md" for name in ("python", "meshes", "c"))
_PYTHON = """# Python

The public names of `import pandis`, made from the docstrings. `help(pandis.Field)` shows all of a
docstring, with shapes, units and errors. Other modules are internal, except `pandis.bridges`.
"""
_MESHES = """# Functions for meshes

The functions of `import pandis` that take a mesh, and what they return, made from the docstrings.
They need `pip install 'pandis-fields[make]'`. The commands of the same names do this with files.
"""
_C = """# C

The functions of `pandis.h`, made from its comments. The header documents each parameter, its range,
and the result of an invalid value. **rt**: may be called in a real-time loop."""


def python_page():
    """Return the page of the package, with a sentence for each class, method and function."""
    return _page(_PYTHON, [name for name in pandis.__all__ if not _takes_meshes(name)])


def meshes_page():
    """Return the page of the functions that take a mesh."""
    return _page(_MESHES, [name for name in pandis.__all__ if _takes_meshes(name)])


def _takes_meshes(name):
    return getattr(pandis, name).__module__.startswith("pandis.pipeline.")


def _page(head, names):
    parts = [head]
    for name in names:
        thing = getattr(pandis, name)
        if inspect.isfunction(thing):
            parts.append(f"## `pandis.{name}{_signature(thing)}`\n\n{_summary(thing)}\n")
            continue
        parts.append(f"## `pandis.{name}`\n\n{_summary(thing)}\n")
        rows = [_row(name, key, member) for key, member in _members(thing)]
        if plain := [call for call, text in rows if not text]:
            rows = [(", ".join(plain), ""), *(row for row in rows if row[1])]
        if rows:
            parts.append("\n".join(f"- {call}{text and ': '}{text}" for call, text in rows) + "\n")
    return "\n".join(parts)


def _members(thing):
    """Yield the names and members of a class's public interface, in source order."""
    for each in reversed(thing.__mro__[:-1]):
        if each.__module__.startswith("pandis."):
            yield from dict.fromkeys(getattr(each, "__dataclass_fields__", ())).items()
            yield from ((k, v) for k, v in vars(each).items() if not k.startswith("_"))


def _row(name, key, member):
    """Return a member's call or name as Markdown, and its sentence; fields of tuples have none."""
    plain = getattr(member, "__func__", member)
    if isinstance(plain, property):
        return f"`.{key}`", _summary(plain)
    if inspect.isfunction(plain):
        owner = f"{name}." if isinstance(member, classmethod | staticmethod) else "."
        return f"`{owner}{key}{_signature(plain)}`", _summary(plain)
    return f"`.{key}`", _summary(plain) if inspect.isclass(plain) else ""


def _signature(function):
    parameters = inspect.signature(function).parameters.values()
    shown = [p.replace(annotation=p.empty) for p in parameters if p.name not in ("self", "cls")]
    return str(inspect.Signature(shown))


def _summary(thing):
    """Return the first sentence of a docstring, as Markdown."""
    text = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")
    return text.replace("``", "`")


def c_page(header):
    """Return a header's page, with each function and the first sentence of its comment."""
    parts, section = [_C], None
    for title, note, call in _functions(header):
        if title != section:
            section = title
            parts.append(f"\n## {title.capitalize()}\n\n| | | |\n|---|---|---|")
        runtime = "rt" if note.startswith("[rt]") else ""
        sentence = re.match(r"(?:\[rt\] )?(.*?[.:])(?: |$)", f"{note} .")[1].rstrip(":.") + "."
        parts.append(f"| `{call}` | {runtime} | {sentence} |".replace("||", r"\|\|"))
    return "\n".join(parts) + "\n"


def _functions(header):
    """Yield section, comment and prototype of each public function of a header."""
    text, body, _ = header.partition("#if defined(PANDIS_IMPLEMENTATION)")
    if not body:
        raise SystemExit("pandis.h: no PANDIS_IMPLEMENTATION block ends its prototypes")
    title, note = "", ""
    lines = iter(text.splitlines())
    for first in lines:
        if first.lstrip().startswith("/*"):
            words = _until("*/", first, lines).strip().removeprefix("/*").partition("*/")[0]
            words = words.replace("\n *", "\n")
            if match := re.match(r" -{10,} ([\w ,]+)", words):
                title = match[1].strip()
            else:
                note = " ".join(words.split())
        elif first.startswith("PANDIS_API ") and "pandis__" not in first:
            call = _until(";", first, lines).removeprefix("PANDIS_API ")
            yield title, note, " ".join(call.split()).replace("( ", "(").rstrip(";")


def _until(end, text, lines):
    """Return a text with the following lines, up to the first line that contains ``end``."""
    while end not in text:
        text += "\n" + next(lines)
    return text

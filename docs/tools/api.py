"""The pages of the interfaces, from docstrings and from the header: what may be called, and why."""

import inspect
import re
from pathlib import Path

import pandis

ROOT = Path(__file__).resolve().parents[2]
PYTHON, C = ROOT / "docs/api/python.md", ROOT / "docs/api/c.md"
_PYTHON = """# Python

What `import pandis` offers, made from the docstrings: `help(pandis.Field)` says it all, with
shapes, units and errors. Everything else is inside, but for the packages of `pandis.bridges`.
"""
_C = """# C

The functions of `pandis.h`, made from its comments: the header says what each parameter is, in
which range it may lie, and what a bad one gives. **rt**: may be called in a loop that must keep its
time."""


def python_page():
    """Return the page of the package: each class with its methods, each function, in a sentence."""
    parts = [_PYTHON]
    for name in pandis.__all__:
        thing = getattr(pandis, name)
        if inspect.isfunction(thing):
            parts.append(f"## `pandis.{name}{_signature(thing)}`\n\n{_summary(thing)}\n")
            continue
        parts.append(f"## `pandis.{name}`\n\n{_summary(thing)}\n")
        rows = [_row(name, key, member) for key, member in _members(thing)]
        if rows:
            parts.append("\n".join(["| | |", "|---|---|", *rows]) + "\n")
    return "\n".join(parts)


def _members(thing):
    """Yield the names and members of a class that a user may touch, in the order of its source."""
    for each in reversed(thing.__mro__[:-1]):
        if each.__module__.startswith("pandis."):
            yield from ((k, v) for k, v in vars(each).items() if not k.startswith("_"))


def _row(name, key, member):
    plain = getattr(member, "__func__", member)
    if isinstance(plain, property):
        return f"| `.{key}` | {_summary(plain)} |"
    if inspect.isfunction(plain):
        owner = f"{name}." if isinstance(member, classmethod | staticmethod) else "."
        return f"| `{owner}{key}{_signature(plain)}` | {_summary(plain)} |"
    return f"| `.{key}` | {_summary(plain) if type(plain).__name__ != '_tuplegetter' else ''} |"


def _signature(function):
    parameters = inspect.signature(function).parameters.values()
    shown = [p.replace(annotation=p.empty) for p in parameters if p.name not in ("self", "cls")]
    return str(inspect.Signature(shown)).replace("|", "\\|")


def _summary(thing):
    """Return the first sentence of a docstring, as Markdown."""
    text = (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")
    return text.replace("``", "`").replace("|", "\\|")


def c_page(header):
    """Return the page of a header: each function, by section, with the sentence above it."""
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
        raise SystemExit("pandis.h: its prototypes end nowhere")
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
            yield title, note, " ".join(call.split()).rstrip(";")


def _until(end, text, lines):
    """Return a text with the lines that follow it, up to the first that holds its end."""
    while end not in text:
        text += "\n" + next(lines)
    return text

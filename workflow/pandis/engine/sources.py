"""C sources: the files that they include, and the tokens that a compiler sees."""

import hashlib
import re

from pandis.engine.cache import remembered

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"', re.M)
#: Comments; strings and characters; names and numbers; line ends; spaces; operators.
_TOKEN = re.compile(
    r"(?P<comment>//(?:\\\n|[^\n])*|/\*.*?\*/)"
    r"|(?P<text>\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*')"
    r"|(?P<word>[A-Za-z_0-9][A-Za-z_0-9.]*)"
    r"|(?P<end>\n)"
    r"|(?P<space>[ \t\r\f\v]+|\\\n)"
    r"|(?P<sign><<=|>>=|\.\.\.|->|\+\+|--|<<|>>|&&|\|\||##|[-+*/%&|^<>=!]=|.)",
    re.S,
)


def included(source):
    """Return a source and all files that it includes in quotes, each once, breadth first.

    Parameters
    ----------
    source : Path

    Returns
    -------
    list of Path
    """
    files, queue = [], [source.resolve()]
    while queue:
        path = queue.pop(0)
        if path not in files:
            files.append(path)
            names = _INCLUDE.findall(path.read_text("utf-8"))
            queue += [(path.parent / name).resolve() for name in names]
    return files


def tokens(text):
    """Return the tokens of C source that a compiler sees, without comments and layout.

    A line end that ends a directive is kept. So is a space between a macro's name and a
    parenthesis: without it, the macro in ``#define f (x)`` would take an argument.
    """
    seen, directive, fresh, spaced = [], False, True, False
    for match in _TOKEN.finditer(text):
        kind, token = match.lastgroup, match[0]
        if kind in ("comment", "space"):
            spaced = True
            continue
        if kind == "end":
            if directive:
                seen.append("\n")
            directive, fresh, spaced = False, True, False
            continue
        if fresh and token == "#":
            directive = True
        defined = directive and seen[-2:-1] == ["define"]
        if defined and token == "(" and spaced:
            seen.append(" ")
        seen.append(token)
        fresh = spaced = False
    return seen


def digest(source):
    """Return a digest (hex) of a source and its includes, ignoring comments and layout."""
    texts = [(path.name, path.read_text("utf-8")) for path in included(source)]

    def of_tokens():
        total = hashlib.sha256()
        for name, text in texts:
            total.update("\0".join([name, *tokens(text)]).encode() + b"\0\0")
        return total.hexdigest()

    return remembered(__file__, repr(texts).encode(), of_tokens)

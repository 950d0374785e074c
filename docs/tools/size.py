"""Count the lines of code of the library: without blank lines, comments and docstrings.

Usage: .venv/bin/python docs/tools/size.py [CHECKOUT]
Counted are Python, rules, C and C# below workflow/, rules/ and scripts/. ``pandis.h`` is joined
from its parts, which are counted.
"""

import ast
import io
import re
import sys
import tokenize
from pathlib import Path

#: Tokens that are no code.
_LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
           tokenize.ENCODING, tokenize.ENDMARKER}  # fmt: skip
_C_COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|/\*.*?\*/|//[^\n]*', re.DOTALL)


def python_lines(text):
    """Return the number of lines of code of Python."""
    documented = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
    docstrings = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, documented) and ast.get_docstring(node) is not None
        for line in range(node.body[0].lineno, node.body[0].end_lineno + 1)
    }
    code = {
        line
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in _LAYOUT
        for line in range(token.start[0], token.end[0] + 1)
    }
    return len(code - docstrings)


def c_lines(text):
    """Return the number of lines of code of C or C#."""

    def shorten(match):
        return match[0] if match[0].startswith('"') else "\n" * match[0].count("\n")

    return sum(bool(line.strip()) for line in _C_COMMENT.sub(shorten, text).splitlines())


def rule_lines(text):
    """Return the number of lines of code of rules."""
    return sum(bool(line.strip()) and not line.lstrip().startswith("#")
               for line in text.splitlines())  # fmt: skip


COUNTS = {".py": python_lines, ".smk": rule_lines, "": rule_lines, ".c": c_lines, ".h": c_lines,
          ".cpp": c_lines, ".cs": c_lines}  # fmt: skip


def main(checkout):
    """Print the lines of each folder, and of each language."""
    root, sums, languages = Path(checkout), {}, {}
    for path in sorted(p for part in ("workflow", "rules", "scripts")
                       for p in (root / part).rglob("*")):  # fmt: skip
        inside = path.relative_to(root)
        counted = path.suffix in COUNTS and (path.suffix or path.name == "Snakefile")
        if path.is_file() and counted and path.name != "pandis.h" and "built" not in inside.parts:
            folder = "/".join(inside.parts[:-1][:4])
            lines = COUNTS[path.suffix](path.read_text(encoding="utf-8"))
            sums[folder] = sums.get(folder, 0) + lines
            languages[path.suffix] = languages.get(path.suffix, 0) + lines
    for folder, lines in sums.items():
        print(f"{lines:7,}  {folder}")
    each = ", ".join(f"{lines:,} {suffix or 'Snakefile'}" for suffix, lines in languages.items())
    print(f"{sum(sums.values()):7,}  in all: {each}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[2])

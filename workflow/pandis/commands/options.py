"""Options of commands that stand for options of the configuration."""

import argparse
import difflib
from types import NoneType
from typing import Literal, get_args, get_origin

from pandis.base.errors import ConfigError
from pandis.pipeline.api.options import FLAT, WHOLE


def add_model(parser, section, *, defaults=None):
    """Add an option for each option of a section of the configuration.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    section : str
        A key of `FLAT`.
    defaults : dict, optional
        Defaults that differ from those of the configuration.
    """
    group = parser.add_argument_group(f"options of `{section}`")
    for name, field in FLAT[section].model_fields.items():
        default = (defaults or {}).get(name, field.get_default(call_default_factory=True))
        if isinstance(default, dict):
            continue  # set by --set
        words = field.description.replace("%", "%%").replace("`", "")
        flag = f"--{name.replace('_', '-')}"
        options = {"dest": name, "default": argparse.SUPPRESS}
        shown = ",".join(map(str, default)) if isinstance(default, list) else default
        if set(get_args(field.annotation)) == {"never", "always"}:
            constant = options | {"action": "store_const"}
            group.add_argument(flag, const="always", help=f"{words} ({default})", **constant)
            group.add_argument(f"--no-{name}", const="never", help=argparse.SUPPRESS, **constant)
            continue
        if isinstance(default, bool):
            shown = "yes" if default else "no"
            options["action"] = argparse.BooleanOptionalAction
        else:
            options["type"] = _several if isinstance(default, list) else _plain
            options["metavar"] = _metavar(field.annotation, name)
        group.add_argument(flag, help=f"{words} ({shown})", **options)


def _metavar(annotation, name):
    """Return the choices of an option, or a word for its value."""
    values = [a for a in get_args(annotation) if a is not NoneType]
    if get_origin(annotation) is Literal:
        return "{" + ",".join(map(str, values)) + "}"
    return name.rpartition("_")[2].upper()


def add_set(parser):
    """Add the option ``--set``, for options that have no flag of their own."""
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="extra",
        help="any option of config/README.md by its path, such as "
        "train.pandis-exact.steps=2000; may be repeated",
    )  # fmt: skip


def options_of(words, sections):
    """Return the options that were given on the command line, as arguments of a function.

    Raises
    ------
    ConfigError
        A ``--set`` is not KEY=VALUE, or its key is not that of an option.
    """
    names = [name for section in sections for name in FLAT[section].model_fields]
    options = {name: getattr(words, name) for name in names if hasattr(words, name)}
    if getattr(words, "seed", None) is not None:
        options["seed"] = words.seed
    for pair in getattr(words, "extra", []):
        key, equals, value = pair.partition("=")
        *path, last = key.split(".")
        if not equals or not path:
            raise _fault(f"--set {pair}", "write SECTION.KEY=VALUE")
        if path[0] not in (*sections, *WHOLE):
            near = difflib.get_close_matches(path[0], [*sections, *WHOLE], n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise _fault(f"--set {pair}", f"there is no section {path[0]}{hint}")
        inner = options
        for name in path:
            inner = inner.setdefault(name, {})
            if not isinstance(inner, dict):
                raise _fault(f"--set {pair}", f"{name} has a value already")
        inner[last] = _plain(value)
    return options


def _fault(where, why):
    return ConfigError(f"{where}: {why}", {where: why})


def _plain(text):
    """Return a number where a text is one, and true or false."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _several(text):
    """Return the values of a list, which are separated by commas."""
    return [_plain(part) for part in text.split(",")]


def as_flags(option):
    """Return options of `mesh` as they are written on the command line."""
    flags = []
    for key, value in option.items():
        flags.append(f"--{key.replace('_', '-')}")
        if value != "always":
            flags.append(",".join(value) if isinstance(value, list) else str(value))
    return " ".join(flags)

"""Builds one field of one mesh."""

import re

from pandis.base.errors import ConfigError
from pandis.base.progress import Log
from pandis.pipeline.api.options import sections
from pandis.pipeline.api.running import stages
from pandis.pipeline.run.ask.budget import AMOUNT
from pandis.pipeline.run.ask.kind import AUTO
from pandis.runtime.field import NativeField

_BYTES = {"B": 1, "bytes": 1, "kB": 1000, "KB": 1000, "MB": 1_000_000}
_SECONDS = {"ns": 1e-9, "µs": 1e-6, "us": 1e-6, "ms": 1e-3}
_SECTIONS = ("mesh", "device", "samples", "bake", "export", "budget", "stress", "train")


def field(
    mesh: object,
    /,
    kind: str = "compact-auto",
    *,
    budget: str | dict[str, object] | None = None,
    log: Log | None = None,
    **options: object,
) -> NativeField:
    """Build a field of a mesh, as the workflow's exports do; ``save`` writes its ``.pandis`` file.

    A mesh that is not valid is repaired first.

    Parameters
    ----------
    mesh : path-like, pair of arrays, or object
        See `pandis.pipeline.api.sources.source_of`.
    kind : str
        A name of `fields` in a configuration, such as ``exact``, ``compact-auto`` or
        ``spline-auto``; or ``auto``, for the cheapest field within a budget.
    budget : str or dict, optional
        With ``auto``: the limits, such as ``"20 mN, 500 kB"``, or the options of `budget`.
    log : callable, optional
        Receives lines about the progress.
    **options
        Options of `mesh`, `device`, `samples`, `bake` and `export` in a configuration, by their own
        names; the sections `stress` and `train` as dicts; ``seed``; and ``name``, the mesh's name
        in a configuration, from which random numbers derive (that of the file).

    Raises
    ------
    PandisError
        The mesh cannot be read or repaired, an option is wrong, or no field meets the budget.
    """
    if (budget is None) == (kind == AUTO):
        raise ConfigError(
            'kind="auto" needs a budget, such as budget="20 mN, 500 kB"'
            if budget is None
            else f'a budget needs kind="auto", not {kind!r}: other kinds have their size in their '
            "name, or a target in `auto`",
            {},
        )
    log = log or (lambda text: None)
    config = sections(options, _SECTIONS)
    config["fields"] = [kind]
    if budget is not None:
        if not isinstance(budget, str | dict):
            raise _wrong(f"expected a text such as '20 mN, 500 kB', or a dict, not {budget!r}")
        config["budget"] = read_budget(budget) if isinstance(budget, str) else dict(budget)
        if "N" in str(config["budget"].get("force_error", "")) and "device" not in config:
            log("newtons are those of an object of 0.10 m at 400 N/m; size and stiffness change it")
    with stages(mesh, config, log) as run:
        return NativeField(run.make(f"export/{kind}.pandis").read_bytes())


def read_budget(text):
    """Return the options of `budget` that a text such as ``20 mN, 500 kB, 2 µs`` names.

    Raises
    ------
    ConfigError
        A part is no limit, two limit the same, or none limits the error.
    """
    limits = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        number, unit = re.fullmatch(r"([\d.eE+-]*)\s*(.*)", part).groups()
        if re.fullmatch(AMOUNT, part):
            key, value = "force_error", part
        elif unit in _BYTES and _is_number(number):
            key, value = "bytes", round(float(number) * _BYTES[unit])
        elif unit in _SECONDS and _is_number(number):
            key, value = "query_time", float(number) * _SECONDS[unit]
        else:
            raise _wrong(
                f"'{part}' is no limit; write a force error (20 mN, 0.02 N, 5 %), a size (500 kB) "
                "and a time of one query (2 us), separated by commas"
            )
        if key in limits:
            raise _wrong(f"'{part}' limits {key} a second time")
        limits[key] = value
    if "force_error" not in limits:
        raise _wrong(
            f"'{text}' has no force error: add one, such as '20 mN, {text.strip()}'"
            if limits
            else "it is empty; write a force error, such as '20 mN'"
        )
    return limits


def _wrong(why):
    return ConfigError(f"budget: {why}", {"budget": why})


def _is_number(text):
    try:
        return 0 < float(text) < float("inf")
    except ValueError:
        return False

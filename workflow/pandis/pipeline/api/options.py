"""Options of functions and commands: those of the configuration, without their sections."""

import difflib

from pandis.base.errors import ConfigError
from pandis.pipeline.run.ask.options import (
    BakeOptions,
    MeshOptions,
    NativeOptions,
    SampleOptions,
    StressOptions,
)
from pandis.pipeline.run.ask.targets import BudgetOptions, DeviceOptions

#: Sections of the configuration whose options are passed by their own names.
FLAT = {
    "mesh": MeshOptions,
    "device": DeviceOptions,
    "samples": SampleOptions,
    "bake": BakeOptions,
    "export": NativeOptions,
}
#: Sections that are passed whole, as dicts.
WHOLE = {"budget": BudgetOptions, "stress": StressOptions, "train": dict}


def sections(options, allowed):
    """Sort options into the sections of a configuration.

    Parameters
    ----------
    options : dict
        Options by name, without their section; whole sections by name, as dicts; ``seed``; and
        ``name``, the mesh's name in a configuration, from which random numbers derive.
    allowed : tuple of str
        The sections that the function uses.

    Returns
    -------
    dict of str to dict

    Raises
    ------
    ConfigError
        An option is unknown.
    """
    names = {key: part for part in allowed if part in FLAT for key in FLAT[part].model_fields}
    sorted_ = {}
    for key, value in options.items():
        if key in allowed:
            if not isinstance(value, dict):
                raise _fault(key, f"expected options by name, not {value!r}")
            sorted_[key] = {**value, **sorted_.get(key, {})}
        elif key in names:
            sorted_.setdefault(names[key], {})[key] = value
        elif key == "seed" and not (type(value) is int and value >= 0):
            raise _fault(key, f"expected a whole number from 0, not {value!r}")
        elif key in ("seed", "name"):
            sorted_[key] = value
        else:
            near = difflib.get_close_matches(key, [*names, *allowed], n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise _fault(key, f"unknown option{hint}")
    return sorted_


def _fault(key, why):
    return ConfigError(f"{key}: {why}", {key: why})

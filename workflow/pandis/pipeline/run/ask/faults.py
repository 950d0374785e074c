"""Collects all faults of a configuration, each with its dotted path and how to correct it."""

import difflib
import re
from typing import get_args, get_origin

from pydantic import BaseModel, ValidationError

from pandis.base.errors import ConfigError
from pandis.pipeline.run.ask.catalogue import (
    AUTO,
    EXAMPLES,
    MESH_NAME,
    SIZED,
    TARGETS,
    is_builtin_field,
    parse_field,
)
from pandis.pipeline.run.ask.config import APART, StageOptions
from pandis.pipeline.run.ask.recipes import ExactRecipe, PaperRecipe


def stage_faults(model, values):
    """Return all faults of stages' options and of field names, as messages by dotted path."""
    faults = faults_of(model, values)
    for key, message in name_faults(values):
        faults.setdefault(key, message)
    return faults


def raise_faults(faults):
    """Raise a ConfigError that lists all faults (messages by dotted path), if there are any."""
    if faults:
        lines = [f"  {key or 'config'}: {message}" for key, message in faults.items()]
        raise ConfigError(
            f"the configuration has {len(lines)} fault{'s' * (len(lines) > 1)}:\n"
            + "\n".join(lines)
            + "\nEvery option is described in config/README.md.",
            faults,
        )


def faults_of(model, values):
    """Return the faults that ``model`` finds in ``values``, as messages by dotted path."""
    try:
        model.model_validate(values)
    except ValidationError as error:
        return dict(_describe(fault, model) for fault in error.errors(include_url=False))
    return {}


def name_faults(values):
    """Yield path and message for every recipe and field with an invalid name."""
    recipes = values.get("train") or {}
    names = values.get("fields", StageOptions.model_fields["fields"].default)
    names = [names] if isinstance(names, str) else names
    if not isinstance(recipes, dict) or not isinstance(names, list):
        return  # the models report wrong types
    for name in recipes:
        if not re.fullmatch(MESH_NAME, str(name)) or is_builtin_field(str(name)):
            yield (
                f"train.{name}",
                "a recipe's name must start with a-z, contain only a-z, 0-9, - and _, and not be "
                "that of a built-in field: rename it",
            )
    known = {"pandis": None, "pandis-exact": None} | recipes
    if AUTO in names and len(names) > 1:
        yield (
            "fields",
            "auto stands alone: the budget describes a single field, so remove the other entries",
        )
        return
    for index, name in enumerate(names):
        if name in names[:index]:
            yield f"fields.{index}", f"{name} is listed twice: remove one"
        try:
            spec = parse_field(str(name), known)
        except ValueError as error:
            near = near_field(str(name), known)
            yield f"fields.{index}", str(error) + (f"; did you mean '{near}'?" if near else "")
            continue
        spec = spec.through or spec
        budget = values.get("budget") or {}
        if spec.kind == AUTO and not (isinstance(budget, dict) and budget.get("force_error")):
            yield (
                f"fields.{index}",
                "auto needs a target: add budget.force_error, such as 0.001",
            )
        if spec.size == AUTO and spec.form not in _targets(values):
            yield (
                f"fields.{index}",
                f"{spec.name} needs a target: add bake.auto.{spec.form}, with force_error or bytes",
            )


def near_field(name, recipes):
    """Return the known field name most similar to an unknown one; None if none is similar."""
    form, dash, size = name.rpartition("-")
    if dash and (size.isdigit() or size == AUTO):
        near = difflib.get_close_matches(form, SIZED, n=1, cutoff=0.7)
        return f"{near[0]}-{size}" if near and near[0] != form else None
    known = [*(one for one in EXAMPLES if not one[-1].isdigit()), *recipes]
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return near[0] if near and near[0] != name else None


def _targets(values):
    """Return the forms of fields that have a target."""
    bake = values.get("bake") or {}
    targets = bake.get("auto") or {} if isinstance(bake, dict) else {}
    return {*TARGETS, *(targets if isinstance(targets, dict) else ())}


def _describe(fault, model):
    path = [str(part) for part in fault["loc"]]
    # pydantic's path contains the tag of the chosen recipe, which is not in the file
    if len(path) > 2 and path[0] == "train" and path[2] in ("paper", "exact"):
        del path[2]
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(path[-1], _known_keys(model, path[:-1], fault), n=1)
        message = "unknown option" + (f"; did you mean '{near[0]}'?" if near else "")
    elif fault["type"] == "missing":
        message = "missing"
    else:
        value = fault.get("input")
        if not isinstance(value, dict | list | BaseModel) and path:
            message += f" (given: {value!r})"
    # the message of a cross-check begins with its key
    if fault["type"] == "value_error" and (match := re.match(r"([a-z][\w.-]*): ", message)):
        path.append(match[1])
        message = message[match.end() :]
    return ".".join(path), message


def _known_keys(model, path, fault):
    if path[:1] == ["train"] and len(path) > 1:
        tag = next((p for p in fault["loc"] if p in ("paper", "exact")), "exact")
        return list((PaperRecipe if tag == "paper" else ExactRecipe).model_fields)
    names = iter(path)
    for part in names:
        field = model.model_fields.get(part)
        kind = getattr(field, "annotation", None)
        if get_origin(kind) is dict:  # options by name
            kind = get_args(kind)[1]
            next(names, None)
        if not (isinstance(kind, type) and issubclass(kind, BaseModel)):
            return []
        model = kind
    return [*model.model_fields, *(APART if model is StageOptions else ())]

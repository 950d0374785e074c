"""The catalogue of fields: their names, and their order in tables."""

import re

from pandis.pipeline.run.ask.kind import AUTO, FieldSpec
from pandis.pipeline.run.ask.kinds import KINDS

MESH_NAME = "[a-z][a-z0-9_-]*"
#: Folders of ``results/`` that do not belong to a mesh.
RESERVED_NAMES = ("logs", "benchmarks", "scenes", "datasets", "native")
#: All forms of fields, in the order in which tables list them.
FORMS = (*(form for kind in KINDS.values() for form in kind.forms), AUTO)
#: Kind of each form.
KIND_OF = {form: kind for kind in KINDS.values() for form in kind.forms}
#: Forms for which `bake.auto` may set a target.
SIZED = tuple(form for kind in KINDS.values() for form in kind.sized)
#: Default target of each form that has one.
TARGETS = {form: target for kind in KINDS.values() for form, target in kind.targets.items()}
#: Field names that the message about an unknown field lists.
EXAMPLES = (
    *(example for kind in KINDS.values() for example in kind.examples),
    *(f"{form}-{AUTO}" for form in TARGETS),
    AUTO,
)


def is_builtin_field(name):
    """Return whether ``name`` names a built-in field: one that is not a recipe."""
    if re.fullmatch(rf"({'|'.join(SIZED)})-(\d+|auto)", name):
        return True
    try:
        parse_field(name, ())
    except UnknownFieldError as error:
        return error.name != name  # true if `name` is a point tracked on an unknown field
    except ValueError:
        return True
    return True


def in_order(names, recipes):
    """Return field names sorted by kind, form, size and name.

    Sorting makes the results independent of the order in the configuration.

    Parameters
    ----------
    names : list of str
    recipes : container of str

    Raises
    ------
    ValueError
        As for `parse_field`.
    """

    def place(name):
        spec = parse_field(name, recipes)
        sized = isinstance(spec.size, int)
        return FORMS.index(spec.form), not sized, spec.size if sized else 0, name

    return sorted(names, key=place)


class _AllNames:
    """A container that has every name."""

    def __contains__(self, name):
        return True


def known_field(name):
    """Return the FieldSpec of a name that planning has accepted: a built-in field or a recipe."""
    return parse_field(name, _AllNames())


class UnknownFieldError(ValueError):
    """No kind has a field of this name."""

    def __init__(self, name, known):
        super().__init__(f"'{name}' is not a field; the fields are {', '.join(known)}")
        self.name = name


def parse_field(name, recipes):
    """Return the FieldSpec of ``name``.

    Parameters
    ----------
    name : str
        An entry of ``fields``.
    recipes : container of str
        Names under ``train``.

    Raises
    ------
    ValueError
        The name is unknown, or its size is out of range.
    """

    def parse(inner):
        return parse_field(inner, recipes)

    if name == AUTO:
        return FieldSpec(name, AUTO, AUTO, "choice")
    specs = [kind.parse(name, parse) for kind in KINDS.values()]
    if name in recipes:  # no recipe has the name of a built-in field
        specs += [kind.parse_recipe(name) for kind in KINDS.values()]
    for spec in filter(None, specs):
        return spec
    raise UnknownFieldError(name, [*EXAMPLES, *recipes])

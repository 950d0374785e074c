"""Which fields there are: what a name stands for, in which order they come."""

import re

from pandis.pipeline.run.ask.kind import AUTO, FieldSpec
from pandis.pipeline.run.ask.kinds import KINDS

MESH_NAME = "[a-z][a-z0-9_-]*"
#: Folders of ``results/`` that are not meshes.
RESERVED_NAMES = ("logs", "benchmarks", "scenes", "native")
#: All fields, whatever their sizes, in the order of tables.
FORMS = (*(form for kind in KINDS.values() for form in kind.forms), AUTO)
#: The kind of a form.
KIND_OF = {form: kind for kind in KINDS.values() for form in kind.forms}
#: Those of which `bake.auto` may name a target, and what holds where the user names none.
SIZED = tuple(form for kind in KINDS.values() for form in kind.sized)
TARGETS = {form: target for kind in KINDS.values() for form, target in kind.targets.items()}
#: Names that an error lists as known.
EXAMPLES = (
    *(example for kind in KINDS.values() for example in kind.examples),
    *(f"{form}-{AUTO}" for form in TARGETS),
    AUTO,
)


def is_builtin_field(name):
    """Tell whether ``name`` is taken by a field that is not a recipe."""
    if re.fullmatch(rf"({'|'.join(SIZED)})-(\d+|auto)", name):
        return True
    try:
        parse_field(name, ())
    except UnknownFieldError as error:
        return error.name != name  # of a field that is tracked on one that is unknown
    except ValueError:
        return True
    return True


def in_order(names, recipes):
    """Return names of fields in the order of the kinds, then by form, by size and by name.

    A configuration may list them in any order: that alone changes no result.

    Parameters
    ----------
    names : list of str
    recipes : container of str

    Raises
    ------
    ValueError
        As of `parse_field`.
    """

    def place(name):
        spec = parse_field(name, recipes)
        sized = isinstance(spec.size, int)
        return FORMS.index(spec.form), not sized, spec.size if sized else 0, name

    return sorted(names, key=place)


class _AllNames:
    """A container of every name."""

    def __contains__(self, name):
        return True


def known_field(name):
    """Return the FieldSpec of a name that planning has passed: of a built-in field or a recipe."""
    return parse_field(name, _AllNames())


class UnknownFieldError(ValueError):
    """No kind has a field of this name."""

    def __init__(self, name, known):
        super().__init__(f"'{name}' is no field; known are {', '.join(known)}")
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
        The name is unknown, or a grid too small or too large.
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

"""Selects fields with distances, for programs that require them."""

from pandis.base.errors import PandisError


def with_distances(fields, log):
    """Return the fields that have distances, and log those that do not.

    Parameters
    ----------
    fields : list of pandis.runtime.field.NativeField
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        No field has distances.
    """
    for field in fields:
        if not field.has_distance:
            log(f"{field.path.stem}: left out: a grid of forces has no distances outside")
    good = [field for field in fields if field.has_distance]
    if not good:
        raise PandisError(
            "all fields are grids of forces, which have no distances outside: add another field to "
            "fields, or remove this format from export.also"
        )
    return good

"""Selects fields that know distances, for programs that need them."""

from pandis.base.errors import PandisError


def with_distances(fields, log):
    """Return the fields that know distances, and log those that do not.

    Parameters
    ----------
    fields : list of pandis.runtime.field.NativeField
    log : callable

    Raises
    ------
    PandisError
        No field does.
    """
    for field in fields:
        if not field.has_distance:
            log(f"{field.path.stem}: left out: a grid of forces knows no distance outside")
    good = [field for field in fields if field.has_distance]
    if not good:
        raise PandisError(
            "all fields are grids of forces, which know no distance outside: name another one in "
            "fields, or take this format out of export.also"
        )
    return good

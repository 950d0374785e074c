"""Small mesh files and what is right for each, generated; and mutations of files, for fuzzing.

A file that is refused must be refused with what any good message names (a line and its token, both
counts, an extension, a file that is missing). Where the standards leave a choice, a case names both
answers: what reads such a file must read it as stated, and what refuses it may.
"""

from pathlib import Path
from typing import NamedTuple

from casework import formats, packages, scenes, texts
from casework.base import Reads, Refuses
from casework.mutate import mutations

__all__ = ["CASES", "Case", "Reads", "Refuses", "case", "mutations"]


class Case(NamedTuple):
    """One file, or several, and what is right.

    Attributes
    ----------
    name : str
    files : dict of str to bytes
        The first is the one to read; the others lie beside it.
    right : Reads or Refuses
    otherwise : Reads, Refuses or None
        What is right too.
    """

    name: str
    files: dict
    right: Reads | Refuses
    otherwise: Reads | Refuses | None = None

    @property
    def either(self):
        """Whether the file may be read, and may be refused."""
        return self.otherwise is not None

    def write(self, folder):
        """Write the files into a folder, and return the path of the one to read."""
        for name, data in self.files.items():
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return Path(folder) / next(iter(self.files))


def _all():
    """Yield every case."""
    for module in (texts, formats, scenes, packages):
        for entry in module.entries():
            yield Case(*entry)


#: Every case, by name in the order of classes.
CASES = tuple(_all())


def case(name):
    """Return the case of a name."""
    return next(each for each in CASES if each.name == name)

"""Exports fields for ``pandis.h``. Each file is compared with the library before it is written.

docs/format.md describes the format. Each kind's ``file`` module defines the file's contents.
"""

from abc import ABC, abstractmethod

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.kinds.check import FORCE_LENGTH, check
from pandis.pipeline.kinds.clearance import clearance
from pandis.pipeline.kinds.exported import ExportedField
from pandis.pipeline.run.ask.kinds import kind_module
from pandis.runtime.field.files import pack


class FieldFile(ABC):
    """The ``.pandis`` file of a field; each kind has a subclass ``File`` in its ``file`` module.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    weight_bits : {32, 16}
        Bits per weight in a network's hidden layers.

    Attributes
    ----------
    version : int
        The first format version that can hold this file.
    answering : pandis.pipeline.kinds.field.Field
        The field whose answers the file must reproduce.
    """

    version = 1

    def __init__(self, field, weight_bits):
        self.field = self.answering = field
        self.weight_bits = weight_bits

    @abstractmethod
    def parts(self):
        """Return the `pandis.runtime.field.files.Parts` of the file."""

    def faces(self, body, original_faces):
        """Return the sections that store each face's original face and material."""
        return {}

    def notes(self, native):
        """Return additional log lines about the opened file."""
        return []

    def data(self, provenance, **sections):
        """Return the file's bytes, with additional sections."""
        parts = self.parts().add(sections)
        return pack(self.field.frame, parts, provenance, version=self.version)

    def differences(self, exported, left_out=None):
        """Compare the file with its field; return the largest differences, by quantity.

        Parameters
        ----------
        exported : ExportedField
        left_out : callable, optional
            Takes the file and points (n, 3), mesh units; returns a mask of those not compared.
        """
        native, double = exported.file, self.double()
        return check(
            native.distance_and_normal, self._reference(self.answering), self.field.frame,
            left_out=left_out and (lambda points: left_out(native, points)),
            double=double and self._reference(double),
        )  # fmt: skip

    def double(self):
        """Return the field in double precision if rounding may affect its normals, else None."""
        return None

    def _reference(self, field):
        return lambda points: (*field.answer(points), self.direction_length(field, points))

    def direction_length(self, field, points):
        """Return the lengths (n,) of a field's directions before normalisation.

        With this default, normals are not compared, because between two walls rounding decides
        the direction.
        """
        return np.full(len(points), FORCE_LENGTH)

    def clearance(self, exported, body):
        """Return the surface's box, the margins and the height that `clearance` measures."""
        return clearance(lambda points: exported.query(points)[::2], body.distance)


def field_file(field, weight_bits=32):
    """Return the `FieldFile` of a field.

    Raises
    ------
    PandisError
        ``pandis.h`` does not support this kind of field.
    """
    try:
        module = kind_module(field.kind, "file")
    except ModuleNotFoundError as error:
        if error.name != f"pandis.pipeline.kinds.{field.kind}.file":
            raise  # a module that it imports is missing
        raise PandisError(f"{field.name}: pandis.h cannot read fields of this kind") from None
    return module.File(field, weight_bits)


def native_bytes(field, provenance, weight_bits=32, *, safe=None):
    """Return the bytes of a field's ``.pandis`` file, without comparing it with the field.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    provenance : dict
    weight_bits : {32, 16}
        Bits per weight in a network's hidden layers.
    safe : ndarray, shape (9,), optional
        From `pandis.pipeline.kinds.clearance.clearance`. Without it a scene queries the field at
        every tick.

    Raises
    ------
    PandisError
        ``pandis.h`` does not support this kind of field.
    """
    sections = {} if safe is None else {"SAFE": np.asarray(safe, np.float64)}
    return field_file(field, weight_bits).data(provenance, **sections)


def export_native(field, body, options, *, provenance, log):
    """Return the bytes of a field's ``.pandis`` file, after comparing it with the field.

    Parameters
    ----------
    field : pandis.pipeline.kinds.field.Field
    body : pandis.pipeline.geometry.body.Body
        The field's body, against which the error of its distances is measured.
    options : pandis.pipeline.run.ask.options.NativeOptions
    provenance : dict
    log : pandis.base.progress.Log

    Raises
    ------
    PandisError
        The answers of ``pandis.h`` differ from the field's.
    """
    file = field_file(field, options.weight_bits)
    parts = file.parts().add(file.faces(body, options.original_faces))
    # the checked file is freed before the next one is made: each can be a gigabyte
    data = pack(field.frame, parts, provenance, version=file.version)
    safe = _checked(file, data, body, log=log)
    parts = parts.add({"SAFE": np.asarray(safe, np.float64)})
    del data
    return pack(field.frame, parts, provenance, version=file.version)


def _checked(file, data, body, *, log):
    """Compare a file with its field, and return its clearance for scenes."""
    exported = ExportedField(file.field.name, data)
    for note in file.notes(exported.file):
        log(note)
    differences = file.differences(exported)
    summary = ", ".join(f"{key} {value:.1g}" for key, value in differences.items())
    log(f"answers as the library does: the largest differences (unit frame) are {summary}")
    safe = file.clearance(exported, body)
    log(
        "a scene trusts its distances in free space to within {:.2g} of the unit frame, and where "
        "they are flagged as bounds to within {:.2g}".format(*safe[6:8])
    )
    return safe


def regions_of(of_face, names):
    """Return the sections with each face's material number (F,) and the materials' names."""
    text = b"".join(name.encode() + b"\0" for name in names)
    return {"REGN": of_face.astype(np.uint8), "RNAM": text}

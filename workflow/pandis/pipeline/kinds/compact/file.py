"""The file of a compact mesh: the bytes that it was packed into."""

import numpy as np

from pandis.engine.packing import BLOCK_BYTES, BRANCH_BYTES
from pandis.pipeline.kinds.check import check_nearest
from pandis.pipeline.kinds.compact.packing import find_originals
from pandis.pipeline.kinds.native import FieldFile, regions_of
from pandis.runtime.field.constants import COMPACT
from pandis.runtime.field.files import Parts


class File(FieldFile):
    """See `FieldFile`."""

    version = 3

    def parts(self):
        """See `FieldFile.parts`."""
        return file_parts(self.field.arrays, self.field.record)

    def faces(self, body, original_faces):
        """See `FieldFile.faces`."""
        regions = body.regions
        if not (original_faces or regions):
            return {}
        originals = find_originals(body, self.field.arrays, self.field.record)
        sections = {"ORIG": originals} if original_faces else {}
        if regions:
            of_face = np.where(originals < 0, 0, regions.of_face[originals])
            sections |= regions_of(of_face, regions.names)
        return sections

    def differences(self, exported):
        """See `FieldFile.differences`."""
        return check_nearest(exported, self.field.engine, self.field.record.rounding)

    def clearance(self, exported, body):
        """See `FieldFile.clearance`. The record has the bounds, so nothing is measured."""
        record = self.field.record
        return np.array([*record.low, *record.high, record.rounding, record.rounding, 0.0])


def file_parts(arrays, record):
    """Return the `pandis.runtime.field.files.Parts` of a compact mesh's file."""
    wholes = [
        record.bits,
        len(arrays["branches"]) // BRANCH_BYTES,
        len(arrays["blocks"]) // BLOCK_BYTES,
        len(arrays["packed"]),
        record.most,
    ]
    sections = {"BRCH": arrays["branches"], "BLCK": arrays["blocks"], "PACK": arrays["packed"]}
    sections["BOND"] = np.array([record.deviation, record.rounding])
    return Parts(COMPACT, wholes, [record.reach], sections)

"""The file of a grid: its nodes, and a mask of the cells that the band covers."""

import numpy as np

from pandis.base.errors import PandisError
from pandis.pipeline.kinds.axes import Axes
from pandis.pipeline.kinds.check import FORCE_LENGTH
from pandis.pipeline.kinds.native import FieldFile
from pandis.runtime.field.constants import GRID, RULES
from pandis.runtime.field.files import Parts


class File(FieldFile):
    """See `FieldFile`."""

    def __init__(self, field, weight_bits):
        super().__init__(field, weight_bits)
        self._boxed = field.axes != Axes.of_cube(field.axes.size)
        # readers of version 1 assume that every grid is on the cube
        self.version = 2 if self._boxed else 1

    def parts(self):
        """See `FieldFile.parts`."""
        field = self.field
        if field.rule not in RULES:
            raise PandisError(f"{field.name}: pandis.h cannot read {field.rule} grids")
        covered = np.packbits(field.covered.ravel())
        sections = {"NODE": field.nodes.astype(np.float32), "COVR": covered}
        corners = (*field.axes.low, *field.axes.high) if self._boxed else ()
        return Parts(GRID, (RULES.index(field.rule), len(field.values)), corners, sections)

    def direction_length(self, field, points):
        """See `FieldFile.direction_length`."""
        return np.minimum(field.direction_length(points), FORCE_LENGTH)

"""The file of a spline: its three lattices as they were fitted."""

from pandis.pipeline.kinds.native import FieldFile
from pandis.runtime.field.constants import SPLINE
from pandis.runtime.field.files import Parts


class File(FieldFile):
    """See `FieldFile`."""

    def parts(self):
        """See `FieldFile.parts`."""
        field, wholes, sections = self.field, {}, {}
        for index, (letter, level) in enumerate(zip("BF", field.levels, strict=True)):
            brick, mask, base = level.index
            stored = field.stored[index]
            wholes |= {index: level.lattice.size, 2 + index: level.bricks}
            wholes |= {4 + index: len(mask), 6 + index: len(stored)}
            sections |= {f"{letter}BRK": brick, f"{letter}MSK": mask, f"{letter}BAS": base}
            sections[f"{letter}COF"] = stored
        sections |= {"RCOF": field.stored[2], "SIDE": field.side_bits}
        lows = [lattice.low for lattice in (*(level.lattice for level in field.levels), field.far)]
        offsets, scales = zip(*field.scales, strict=True)
        reals = [*lows, *offsets, *scales, field.band.inside, field.band.outside]
        numbers = [*(wholes[k] for k in range(8)), field.far.size]
        return Parts(SPLINE, numbers, reals, sections)

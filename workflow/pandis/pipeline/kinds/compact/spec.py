"""Names and options of compact meshes."""

import re
from typing import ClassVar

from pandis.pipeline.run.ask.kind import AUTO, BuildTask, FieldSpec, Kind, check_size

#: Minimum and maximum bits per coordinate.
BITS = 10, 20


class CompactTask(BuildTask):
    """Pack a mesh on a lattice of `bits` bits per axis."""

    bits: int
    seed: int


class Compact(Kind):
    """The mesh with its vertices on a lattice: `compact-{bits}`, `compact-auto`."""

    name = "compact"
    help = (
        "`compact-B` (the mesh with its vertices on a lattice of B bits, 10 to 20, or "
        "`compact-auto`: see `bake.auto`)"
    )
    forms = sized = (name,)
    examples = ("compact-16",)
    targets: ClassVar = {name: {"bytes": 500_000}}
    colours: ClassVar = {name: "#546e7a"}
    chosen = regions = True
    task = CompactTask

    def parse(self, name, parse):
        """See `Kind.parse`."""
        match = re.fullmatch(rf"{self.name}-([1-9]\d*|auto)", name)
        if not match:
            return None
        bits = AUTO if match[1] == AUTO else check_size(name, match[1], BITS, unit="bits")
        return FieldSpec(name, self.name, self.name, name, bits)

    def sized_options(self, job, spec):
        """See `Kind.sized_options`."""
        return CompactTask(kind=self.name, bits=spec.size, seed=job.seed)

    def stream(self, spec):
        """See `Kind.stream`."""
        return ("bake_compact_auto" if spec.size == AUTO else "bake_compact",)


KIND = Compact()

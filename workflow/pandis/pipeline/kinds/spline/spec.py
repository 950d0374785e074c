"""Names and options of splines."""

import re
from typing import ClassVar

from pandis.pipeline.run.ask.kind import AUTO, BuildTask, FieldSpec, Kind, check_size

#: Minimum and maximum number of nodes per axis.
_NODES = 32, 320


class SplineTask(BuildTask):
    """Fit one spline."""

    size: int
    band: tuple[float, float]
    seed: int


class Spline(Kind):
    """Banded, refined, quantised tricubic splines: `spline-{nodes}`, `spline-auto`."""

    name = "spline"
    help = "`spline-N` (N nodes per axis, or `auto`: see `bake.auto`)"
    forms = sized = (name,)
    examples = ("spline-64",)
    targets: ClassVar = {name: {"bytes": 800_000}}
    colours: ClassVar = {name: "#8b2be2"}
    chosen = True
    task = SplineTask

    def parse(self, name, parse):
        """See `Kind.parse`."""
        match = re.fullmatch(rf"{self.name}-([1-9]\d*|auto)", name)
        if not match:
            return None
        auto = match[1] == AUTO
        size = AUTO if auto else check_size(name, match[1], _NODES, unit="nodes per axis")
        return FieldSpec(name, self.name, self.name, f"grid-{name}", size, exports=("vti",))

    def sized_options(self, job, spec):
        """See `Kind.sized_options`."""
        return SplineTask(kind=self.name, size=spec.size, band=job.band, seed=job.seed)

    def stream(self, spec):
        """See `Kind.stream`."""
        return ("bake_auto" if spec.size == AUTO else "bake_spline",)


KIND = Spline()

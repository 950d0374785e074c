"""The name of the exact field."""

from typing import ClassVar

from pandis.pipeline.run.ask.kind import FieldSpec, Kind


class Exact(Kind):
    """The mesh itself: nothing is built."""

    name = "exact"
    help = f"`{name}`"
    forms = examples = (name,)
    colours: ClassVar = {name: "#111111"}
    chosen = regions = True

    def parse(self, name, parse):
        """See `Kind.parse`."""
        return FieldSpec(name, self.name, name, "mesh") if name == self.name else None


KIND = Exact()

"""Names of the methods with which the paper compares its own."""

import re
from typing import ClassVar

from pandis.pipeline.run.ask.kind import AUTO, FieldSpec, Kind, check_size

#: [16]: planes alone, with their distance maps, and with the slopes of the maps as well.
PLANES = ("support-planes-only", "support-planes-distance", "support-planes")
#: [22]: a contact point tracked on the exact surface, or on another field's.
PROXY = "salisbury"
#: [10] applied to x² + y² + z² - 1, on the unit sphere.
ALGEBRAIC = "kim-algebraic"


class Paper(Kind):
    """Methods kept only for comparison: no exported program evaluates them."""

    name = "paper"
    forms = (ALGEBRAIC, PROXY, *PLANES)
    examples = (*PLANES, PROXY)
    colours: ClassVar = {ALGEBRAIC: "#d7ccc8", PROXY: "#00897b"}
    colours |= dict(zip(PLANES, ("#b0bec5", "#90a4ae", "#607d8b"), strict=True))

    def parse(self, name, parse):
        """See `Kind.parse`."""
        if name in PLANES:
            return self._spec(name, name, "method-support-planes")
        if name == PROXY or name.startswith(f"{PROXY}-"):
            inner = parse(name.removeprefix(PROXY).removeprefix("-") or "exact")
            _check_tracked(name, inner)
            return self._spec(name, PROXY, inner.artifact, through=inner)
        if match := re.fullmatch(rf"{ALGEBRAIC}-([1-9]\d*)", name):
            size = check_size(name, match[1], (4, 512), unit="nodes per axis")
            return self._spec(name, ALGEBRAIC, "mesh", size=size)
        return None

    def _spec(self, name, form, stem, *, size=None, through=None):
        return FieldSpec(name, self.name, form, stem, size, native=False, through=through)


def _check_tracked(name, inner):
    if inner.through:
        raise ValueError(f"{name}: a contact point is tracked on a field, not on another point")
    if inner.kind == AUTO:
        raise ValueError(f"{name}: a contact point is tracked on a given field: name it, not auto")
    if not inner.distances:
        raise ValueError(
            f"{name}: {inner.name} has no distances outside the surface, where a contact point "
            "is sought; use trilinear-normal or tricubic instead"
        )


KIND = Paper()

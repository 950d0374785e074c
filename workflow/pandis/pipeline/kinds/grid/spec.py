"""Names and options of regular grids."""

import re
from typing import ClassVar

from pandis.pipeline.run.ask.kind import AUTO, BuildTask, FieldSpec, Kind, check_size

#: Name suffix of grids that span only the box around the surface, as in the paper.
BOX = "-box"
#: What a grid's nodes store for each interpolation. With the suffix `BOX`, the nodes span the box
#: around the surface instead of the cube [-1, 1]³.
CONTENTS = {
    "nearest": "force",
    "trilinear": "force",
    "nearest-box": "force-box",
    "trilinear-box": "force-box",
    "trilinear-normal": "normal",
    "trilinear-gradient": "distance",
    "tricubic": "distance",
    "kim": "distance",
    "kim-ray": "distance",
    "kim-cell": "distance",
}
#: Interpolations kept only for comparison. No exported program evaluates them.
_COMPARED = ("kim", "kim-ray", "kim-cell")
#: Interpolations that `fields: auto` tries.
TRIED = ("nearest", "trilinear", "trilinear-normal", "trilinear-gradient", "tricubic")
#: Minimum and maximum nodes per axis.
_NODES = 4, 512


class GridTask(BuildTask):
    """Compute one grid. `band` gives its extent below and above the surface (unit frame)."""

    content: str
    size: int
    band: tuple[float, float]
    chunk: int


class Grid(Kind):
    """Grids of values at regular nodes, named `{form}-{nodes}` or `{form}-auto`."""

    name = "grid"
    help = ", ".join(f"`{form}-N`" for form in CONTENTS)
    forms = sized = tuple(CONTENTS)
    examples = tuple(f"{form}-64" for form in forms)
    colours: ClassVar = {
        "nearest": "#c9a227",
        "trilinear": "#2a9d5c",
        "nearest-box": "#e3cf83",
        "trilinear-box": "#86c9a3",
        "trilinear-normal": "#1f6f8b",
        "trilinear-gradient": "#5fa8d3",
        "tricubic": "#3a56c5",
        "kim": "#8d6e63",
        "kim-ray": "#a1887f",
        "kim-cell": "#bcaaa4",
    }
    chosen = True
    task = GridTask

    def parse(self, name, parse):
        """See `Kind.parse`."""
        match = re.fullmatch(rf"({'|'.join(CONTENTS)})-([1-9]\d*|auto)", name)
        if not match:
            return None
        form, size = match.groups()
        content, compared = CONTENTS[form], form in _COMPARED
        stem = f"grid-{form}-auto" if size == AUTO else f"grid-{content}-{size}"
        size = AUTO if size == AUTO else check_size(name, size, _NODES, unit="nodes per axis")
        return FieldSpec(
            name, self.name, form, stem, size,
            exports=("vti",) if compared else ("onnx", "vti"),
            native=not compared, distances=content.removesuffix(BOX) != "force",
        )  # fmt: skip

    def sized_options(self, job, spec):
        """See `Kind.sized_options`."""
        return GridTask(
            kind=self.name, content=CONTENTS[spec.form], size=spec.size, band=job.band,
            chunk=job.entry.bake.chunk,
        )  # fmt: skip

    def stream(self, spec):
        """See `Kind.stream`."""
        return ("bake_auto",)


KIND = Grid()

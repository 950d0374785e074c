"""Draws a solid cut open, so that one sees what is inside."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from pandis.pipeline.mesh.topology import edges_of
from pandis.pipeline.report.picture import save

_INSIDE, _SOURCE, _INVENTED = "#dce3ef", "#33415c", "#3ca05a"


def sections(vertices, faces, far):
    """Draw three sections through the middle of a closed mesh.

    Parameters
    ----------
    vertices, faces : ndarray
        Unit frame.
    far : ndarray, shape (F,), bool
        Faces where the source has no surface.
    """
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    for axis, name in enumerate("xyz"):
        axes = figure.add_subplot(1, 3, axis + 1)
        others = [k for k in range(3) if k != axis]
        loops, cut = loops_at(vertices, faces, axis, at=middle[axis] + 1e-4 * np.pi)
        loops = [loop[:, others] for loop in loops]
        if loops:
            codes = [[Path.MOVETO] + [Path.LINETO] * (len(loop) - 1) + [Path.CLOSEPOLY]
                     for loop in loops]  # fmt: skip
            outline = Path(
                np.concatenate([np.concatenate([loop, loop[:1]]) for loop in loops]),
                np.concatenate(codes),
            )
            axes.add_patch(PathPatch(outline, facecolor=_INSIDE, edgecolor="none"))
        for chosen, tint in ((~far, _SOURCE), (far, _INVENTED)):
            lines = [ends[:, others] for face, ends in cut.items() if chosen[face]]
            axes.add_collection(LineCollection(lines, colors=tint, linewidths=1.2))
        axes.set_xlim(vertices[:, others[0]].min() - 0.05, vertices[:, others[0]].max() + 0.05)
        axes.set_ylim(vertices[:, others[1]].min() - 0.05, vertices[:, others[1]].max() + 0.05)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(f"across {name}")
    for tint, name in ((_SOURCE, "the source's surface"), (_INVENTED, "invented"),
                       (_INSIDE, "solid")):  # fmt: skip
        figure.axes[0].plot([], [], "s", color=tint, label=name)
    figure.legend(frameon=False, loc="outside lower center", ncols=3)
    return save(figure)


def loops_at(vertices, faces, axis, *, at):
    """Cut a closed, oriented mesh with a plane across an axis, on which no vertex lies.

    Returns
    -------
    loops : list of ndarray, shape (n, 3)
        The solid lies on the same side of all.
    cut : dict of int to ndarray, shape (2, 3)
        The ends of each cut face's part in the plane.
    """
    height = vertices[:, axis] - at
    edges = edges_of(np.asarray(faces, np.int64))
    one, other = edges.edges.T
    crosses = (height[one] > 0) != (height[other] > 0)
    share = height[one] / np.where(crosses, height[one] - height[other], 1.0)
    point = vertices[one] + share[:, None] * (vertices[other] - vertices[one])
    above = height[faces] > 0
    then = np.roll(above, -1, axis=1)
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    of_face = edges.edge_of.reshape(-1, 3)[cut]
    # a face crosses the plane upward along one edge and downward along another
    up = of_face[(~above & then)[cut]]
    down = of_face[(above & ~then)[cut]]
    after, loops = dict(zip(up.tolist(), down.tolist(), strict=True)), []
    while after:
        loop = [next(iter(after))]
        while loop[-1] in after:
            loop.append(after.pop(loop[-1]))
        loops.append(point[loop[:-1]])
    ends = np.stack([point[up], point[down]], axis=1)
    return loops, dict(zip(cut.tolist(), ends, strict=True))

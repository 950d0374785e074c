"""Draw docs/images/pipeline.png: a mesh, its field in a slice, and the force on a probe.

Usage: PYTHONPATH=workflow .venv/bin/python docs/tools/picture.py

Needs the bunny of the default run in results/.
"""

import numpy as np
from matplotlib.figure import Figure

import pandis
from generate import ROOT
from pandis.base.frame import Frame
from pandis.pipeline.report.render import render
from pandis.pipeline.run.job.artifact import read_artifact

HOME = ROOT / "results" / "bunny"
#: z of the slice, points along each of its sides, and depth of the deepest probe (unit frame).
SLICE, NODES, DEEP = -0.05, 500, 0.06


def main():
    """Draw the picture."""
    mesh = read_artifact(HOME / "mesh.zarr.zip")
    frame = Frame.of(mesh)
    field = pandis.load(HOME / "export" / "exact.pandis")
    figure = Figure(figsize=(10.4, 3.9), layout="constrained")
    axes = [figure.add_subplot(1, 3, k + 1) for k in range(3)]
    axes[0].imshow(render(frame.to_unit(mesh.arrays["vertices"]), mesh.arrays["faces"], size=700))
    axes[0].set_title("a mesh")

    side = np.linspace(-1, 1, NODES)
    across, up = np.meshgrid(side, side)
    points = np.column_stack([across.ravel(), up.ravel(), np.full(NODES**2, SLICE)])
    distance, normal = field.distance_and_normal(frame.to_mesh(points))
    distance = (distance * frame.scale).reshape(across.shape)
    levels = np.linspace(-0.5, 0.5, 41)
    axes[1].contourf(across, up, np.clip(distance, -0.5, 0.5), levels, cmap="RdBu_r")
    axes[1].contour(across, up, distance, [0], colors="black", linewidths=1.4)
    axes[1].set_title("distance in a slice: red outside, blue inside")

    axes[2].contourf(across, up, distance, [-2, 0], colors=["#dfe5f0"])
    axes[2].contour(across, up, distance, [0], colors="black", linewidths=1.4)
    inside = (distance < 0) & (distance > -DEEP) & (distance < -0.01)
    rows, columns = np.nonzero(inside)
    few = np.random.default_rng(2).permutation(len(rows))
    shown, taken = [], np.full((NODES, NODES), False)
    for index in few:  # no two arrows closer than a thirtieth of the picture
        row, column = rows[index], columns[index]
        near = taken[max(0, row - 16) : row + 17, max(0, column - 16) : column + 17]
        if not near.any():
            taken[row, column] = True
            shown.append(index)
    rows, columns = rows[shown], columns[shown]
    push = -distance[rows, columns, None] * normal.reshape(NODES, NODES, 3)[rows, columns]
    axes[2].quiver(
        side[columns], side[rows], push[:, 0], push[:, 1],
        color="#c62828", angles="xy", scale_units="xy", scale=0.4, width=0.006,
    )  # fmt: skip
    axes[2].set_title("the force on a probe that is pushed in")
    for panel in axes:
        panel.set_aspect("equal")
        panel.axis("off")
    for panel in axes[1:]:
        panel.set(xlim=(-0.95, 0.95), ylim=(-0.95, 0.95))
    figure.savefig(ROOT / "docs/images/pipeline.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()

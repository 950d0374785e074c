"""Turns any triangles into one closed surface around what a person would call their solid.

The mesh may be open, cross itself, face both ways, or consist of loose triangles. See
`pandis.engine.solid` for the lattice, `pandis.pipeline.mesh.solid.rooms` for what is solid.
"""

from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.solid import Lattice, rims
from pandis.pipeline.mesh.deviation import Surface
from pandis.pipeline.mesh.solid.finish import finish
from pandis.pipeline.mesh.solid.rooms import solid_rooms
from pandis.pipeline.mesh.solid.source import MARGIN, source_of
from pandis.pipeline.run.ask.values import CELLS, UNITS, fineness

#: Fewest and most cells along the longest side.
FEWEST, MOST = CELLS
#: Cells per error asked for: 99 % of the visible source lies within half a cell of most solids.
_CELLS_PER_ERROR = 0.5
#: An error must be at most this part of the longest side: a larger one is a slip.
_COARSEST = 16
#: Largest half width of a door, as a share of the radius of the smaller room.
_DOOR = 0.6
#: Half thickness of sheets of nodes, cells: less leaves holes, more joins neighbours.
_HALF = 0.875
#: A fan closes a rim if most of its triangles are farther from the source than this share of the
#: rim's width.
_OFF = 0.02
#: Width of the strips along open edges, cells: cracks of twice this width are closed.
_STRIP = 0.25
#: Coarsest rounding of coordinates, cells.
_ROUGH = 1e-3
#: Bytes per node of a closed and of an open source, and per cell of the box's sides, for the price.
_NODE, _SURFACE = (8, 22), 400


class SolidRules(NamedTuple):
    """What counts as solid, and how finely it is drawn.

    Attributes
    ----------
    cells : int
        Cells along the longest side.
    thickness : float
        Thickness of sheets, cells.
    widest_door, widest_cap : float
        Largest gap between open edges, and largest hole, that can be closed: shares of the
        diagonal.
    share : float
        Largest share of a room's walls that may be invented.
    keep_cavities : bool
    debris : float
        Components below this share of the volume are dropped.
    tolerance : float
        Largest distance of a neighbour from the planes of the faces around a vertex that merges
        into it, cells; 0: no simplification.
    """

    cells: int = 256
    thickness: float = 0.3
    widest_door: float = 0.15
    widest_cap: float = 1.0
    share: float = 0.25
    keep_cavities: bool = True
    debris: float = 0.0
    tolerance: float = 0.1


def rules_of(options, vertices):
    """Return the rules that options of `mesh` ask for.

    Parameters
    ----------
    options : pandis.pipeline.run.ask.options.MeshOptions
    vertices : ndarray, shape (V, 3)
        Used vertices of the mesh.

    Raises
    ------
    PandisError
        `mesh.solid_error` is out of range, or its unit is not that of the mesh.
    """
    (number, unit), extent = fineness(options.solid_error), np.ptp(vertices, axis=0)
    if unit != "cells":
        units = {"": 1.0, "%": float(np.linalg.norm(extent)) / 100}
        if options.unit in UNITS and unit in UNITS:
            units[unit] = UNITS[unit] / UNITS[options.unit]
        if unit not in units:
            raise PandisError(
                f"mesh.solid_error: {options.solid_error}: the unit of the mesh is "
                f"{options.unit}; set `mesh: {{unit: mm}}`, or give the error in mesh units"
            )
        with np.errstate(over="ignore"):
            number = extent.max() / (number * units[unit]) * _CELLS_PER_ERROR
        if number < _CELLS_PER_ERROR * _COARSEST:
            raise PandisError(
                f"mesh.solid_error: {options.solid_error} is more than 1/{_COARSEST} of the mesh's "
                "longest side; write `256 cells` for a number of cells"
            )
        number = np.ceil(number) + 2 * MARGIN
    if number > MOST:
        raise PandisError(
            f"mesh.solid_error: {options.solid_error} takes {number:.6g} cells along the longest "
            f"side; {MOST} are possible"
        )
    return SolidRules(
        cells=max(int(number), FEWEST),
        thickness=options.solid_thickness,
        widest_door=options.solid_door,
        widest_cap=options.solid_cap,
        share=options.solid_share,
        keep_cavities=options.solid_cavities == "kept",
        debris=options.solid_debris,
    )


def make_solid(vertices, faces, rules=None, *, log=print):
    """Return one closed, outward oriented surface without self-intersections.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (F, 3), int64
    rules : SolidRules, optional
    log : pandis.base.progress.Log

    Returns
    -------
    pandis.pipeline.mesh.solid.finish.Solid

    Raises
    ------
    PandisError
        Nothing has an area, or memory is short.
    """
    rules = rules or SolidRules()
    source = source_of(vertices, faces, rules.cells)
    frame = source.frame
    size = " x ".join(map(str, frame.size.tolist()))
    nodes, sides = np.prod(frame.size.astype(float)), frame.size * np.roll(frame.size, 1)
    needed = nodes * _NODE[not source.closed] + 2 * sides.sum() * _SURFACE
    log(f"solid: {size} nodes of {frame.cell:.4g} mesh units; about {needed / 1e6:,.0f} MB")
    fans, fan_of, widths, ajar = _caps(source, rules.widest_cap * source.diagonal)
    strips = _strips(source, ajar)
    corners = np.concatenate([source.vertices[source.faces], fans, strips])
    caps = len(fans) + len(strips)
    bits = np.zeros(len(corners), np.uint8)
    bits[: len(source.faces)] = ajar @ np.array([1, 2, 4])
    if np.spacing(np.abs(source.vertices).max()) > _ROUGH * frame.cell:
        raise PandisError(
            f"the mesh lies too far from the origin for its size: its coordinates are rounded to "
            f"more than {_ROUGH:g} of a cell of {frame.cell:.4g}; move it to the origin"
        )
    corners = frame.to_cells(corners)
    lattice = Lattice(corners, bits, caps=caps, strips=len(strips), size=frame.size)
    widest = max(rules.widest_door * source.diagonal / frame.cell / 2, 2.0)
    middles = lattice.find_rooms(widest, _DOOR)
    rooms = solid_rooms(
        lattice, frame.to_mesh(middles), source,
        share=rules.share, keep_cavities=rules.keep_cavities,
    )  # fmt: skip
    boundary, parts = lattice.boundary(rooms.solid, _HALF)
    del lattice  # it takes as much memory as all that follows
    fan = rooms.caps - len(source.faces)
    shut = widths[np.unique(fan_of[fan[fan < len(fan_of)]])]
    solid = finish(boundary, source, rules, parts=parts, rooms=rooms, caps=shut.tolist())
    log(f"solid: {len(boundary.faces):,} faces, {len(solid.faces):,} after simplification")
    return solid


def _caps(source, widest):
    """Cover rims with fans around their middles.

    Returns
    -------
    fans : ndarray, shape (n, 3, 3)
        Fans that close their rims. One that lies on the source, as over the rim of a panel, closes
        nothing and is left out.
    fan_of : ndarray, shape (n,)
        The fan of each of these triangles.
    widths : ndarray
        Widths of these fans' rims.
    ajar : ndarray, shape (F, 3), bool
        Open edges that no fan closes.
    """
    vertices, open_edges = source.vertices, source.open_edges
    directed = source.faces[:, [[0, 1], [1, 2], [2, 0]]]
    loops = rims(directed[open_edges], len(vertices))
    widths = np.array([np.linalg.norm(np.ptp(vertices[loop], axis=0)) for loop in loops])
    fans = np.concatenate([np.empty((0, 3, 3)), *(_fan(vertices[loop]) for loop in loops)])
    fan_of = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    closing, closed = np.zeros(len(loops), bool), np.zeros(len(vertices), bool)
    if len(loops):
        distance = Surface(vertices, source.faces).distance(fans.mean(axis=1))
        off = np.bincount(fan_of, distance > _OFF * widths[fan_of])
        closing = (off > 0.5 * np.bincount(fan_of)) & (widths <= widest)
    for k in np.flatnonzero(closing):
        closed[loops[k]] = True
    ajar = open_edges & ~closed[directed.reshape(-1, 3, 2)].all(axis=2)
    closes = closing[fan_of]
    return fans[closes], (np.cumsum(closing) - 1)[fan_of[closes]], widths[closing], ajar


def _fan(rim):
    """Return the triangles (n, 3, 3) from a rim (n, 3) to its middle."""
    middle = np.broadcast_to(rim.mean(axis=0), rim.shape)
    return np.stack([rim, np.roll(rim, -1, axis=0), middle], axis=1)


def _strips(source, ajar):
    """Return triangles (n, 3, 3) that continue faces a little beyond their open edges.

    They close cracks: an edge of the lattice could pass through one far from any node.
    """
    face, k = np.nonzero(ajar)
    corners = source.vertices[source.faces]
    start, end, apex = (corners[face, (k + i) % 3] for i in range(3))
    along = end - start
    away = start - apex
    away -= along * ((away * along).sum(axis=1) / (along**2).sum(axis=1))[:, None]
    size = np.linalg.norm(away, axis=1)
    away = away[size > 0] / size[size > 0, None] * _STRIP * source.frame.cell
    start, end = start[size > 0], end[size > 0]
    near = np.stack([start, end, end + away], axis=1)
    return np.concatenate([near, np.stack([start, end + away, start + away], axis=1)])

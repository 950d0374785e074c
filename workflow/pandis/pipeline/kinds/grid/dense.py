"""Dense grids: only the needed nodes are computed, and the others are filled in when read.

Nodes lie on the cube [-1, 1]³, at ``linspace(-1, 1, n)`` along each axis. If the name of the
content ends in ``-box``, they lie on the box around the surface, as in the paper: see
`pandis.pipeline.kinds.axes`.

Contents of a node (``content``):

``force``
    the penetration vector -min(d, 0)·n, three floats: the force at k = 1, as
    the paper's 12 bytes per node imply. Outside the shape it is zero.
``normal``
    distance and normal, four floats.
``distance``
    the distance alone.

Only the nodes needed to interpolate in the band are computed; they are exact. Of the others only
the side is known and stored: ±inf as distance, NaN as a force below the band. Chunks that lie
wholly outside are not stored.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt

from pandis.base.forces import penalty_force
from pandis.pipeline.kinds.axes import Axes
from pandis.pipeline.kinds.band import Band, find_cells, needed_nodes
from pandis.pipeline.kinds.grid.spec import BOX
from pandis.pipeline.kinds.record import DenseRecord

CHANNELS = {"force": 3, "normal": 4, "distance": 1}
#: Value of all nodes of a chunk that is not stored.
FILL = {"force": 0.0, "normal": np.inf, "distance": np.inf}
#: Grids that store only distances round them to this many steps per unit: the resolution of float32
#: at 1. Finer digits mean nothing, and would take up a fifth of the file.
_LEVELS = 2.0**23
#: Number of nodes on each side, beyond the corners of a cell, that interpolation needs.
REACH = {"force": 0, "normal": 0, "distance": 1}


class DenseGrid:
    """The nodes of one grid, to be written slab by slab.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    content : {"force", "force-box", "normal", "distance"}
    size : int
        Nodes per axis.
    band : pandis.pipeline.kinds.band.Band
    progress : pandis.base.progress.Progress
    """

    def __init__(self, engine, content, size, *, band, progress):
        self.content, self.size, self.band = content.removesuffix(BOX), size, Band(*band)
        boxed = content.endswith(BOX)
        self.axes = Axes.of_bounds(size, engine) if boxed else Axes.of_cube(size)
        cells, signs = find_cells(engine, size, self.band, low=self.axes.low, step=self.axes.step)
        needed = needed_nodes(cells, size, REACH[self.content])
        self.inside = _inside_nodes(signs)
        self.nodes = np.flatnonzero(needed.reshape(-1))
        del needed, signs
        self.values = self._evaluate(engine, progress("nodes", len(self.nodes)))

    def _evaluate(self, engine, report):
        """Return the exact values (m, channels) of the needed nodes, float32."""
        values = np.empty((len(self.nodes), CHANNELS[self.content]), np.float32)
        for start in range(0, len(self.nodes), 1 << 18):
            part = slice(start, start + (1 << 18))
            index = np.stack(np.unravel_index(self.nodes[part], (self.size,) * 3), axis=1)
            distance, normal = engine.distance_and_normal(self.axes.nodes(index))
            if self.content == "force":
                values[part] = penalty_force(distance, normal)
            elif self.content == "normal":
                values[part, 0], values[part, 1:] = distance, normal
            else:
                values[part, 0] = np.rint(distance * _LEVELS) / _LEVELS
            report.update(min(start + (1 << 18), len(self.nodes)))
        return values

    @property
    def shape(self):
        """Shape of the stored array: the axes x, y, z, and channels if there is more than one."""
        channels = CHANNELS[self.content]
        return (self.size,) * 3 + ((channels,) if channels > 1 else ())

    def column(self, chunk):
        """Return the declaration of the values for `ArtifactWriter`."""
        chunks = (min(chunk, self.size),) * 3 + self.shape[3:]
        return {
            "shape": self.shape,
            "dtype": np.float32,
            "chunks": chunks,
            "fill": FILL[self.content],
        }

    def slabs(self, thickness):
        """Yield the values in slabs of ``thickness`` layers of nodes, along x."""
        layer = self.size**2
        for start in range(0, self.size, thickness):
            stop = min(start + thickness, self.size)
            slab = np.zeros(((stop - start) * layer, CHANNELS[self.content]), np.float32)
            inside = self.inside[start:stop].reshape(-1)
            if self.content == "force":
                slab[inside] = np.nan
            else:
                slab[:, 0] = np.where(inside, -np.inf, np.inf)
            low, high = np.searchsorted(self.nodes, [start * layer, stop * layer])
            slab[self.nodes[low:high] - start * layer] = self.values[low:high]
            yield slab.reshape((stop - start, *self.shape[1:]))

    def attributes(self):
        """Return attributes that describe the grid to readers without pandis."""
        outside = "0" if self.content == "force" else "inf"
        inside = "NaN" if self.content == "force" else "-inf"
        return DenseRecord(
            content=self.content,
            **self.axes.attributes(),
            band=self.band._asdict(),
            exact_nodes=len(self.nodes),
            beyond_the_band={"outside": outside, "inside": inside},
        ).attributes()


def _inside_nodes(signs):
    """Return a mask of the nodes that touch a cell wholly inside."""
    size = len(signs) + 1
    inside = np.zeros((size,) * 3, bool)
    for shift in np.ndindex(2, 2, 2):
        to = tuple(slice(s, s + size - 1) for s in shift)
        inside[to] |= signs < 0
    return inside


def complete(values, content, axes):
    """Fill the nodes beyond the band from the nearest exact node.

    The distance between the two nodes is added to the exact distance. The sum is right to within
    a cell's diagonal, since the shortest path to the surface passes through the band.

    Parameters
    ----------
    values : ndarray, shape (n, n, n) or (n, n, n, channels), float32
        As stored.
    content : str
    axes : pandis.pipeline.kinds.axes.Axes

    Returns
    -------
    values : ndarray
        The same array, with all values finite.
    exact : ndarray, shape (n, n, n), bool
    """
    if content == "force":
        beyond = np.isnan(values[..., 0])
        source = ~beyond & values.any(axis=-1)
        if not beyond.any() or not source.any():
            return np.nan_to_num(values), ~beyond
        nearest, way = _nearest(beyond, source, axes.step)
        known = values[tuple(nearest)].astype(np.float64)
        depth = np.linalg.norm(known, axis=1)
        values[beyond] = known * ((depth + way) / depth)[:, None]
        return values, ~beyond
    distance = values if content == "distance" else values[..., 0]
    beyond = np.isinf(distance)
    if not beyond.any():
        return values, ~beyond
    side = np.sign(distance[beyond])
    nearest, way = _nearest(beyond, ~beyond, axes.step)
    known = distance[tuple(nearest)]
    same = np.sign(known) == side
    distance[beyond] = side * np.where(same, np.abs(known) + way, way)
    if content == "normal":
        values[beyond, 1:] = values[tuple(nearest)][:, 1:]
    return values, ~beyond


def _nearest(nodes, source, step):
    """For each wanted node, return the nearest source node (3, m) and the distance to it (m,)."""
    shape = step / step[0]
    _, index = distance_transform_edt(~source, sampling=shape, return_indices=True)
    nearest = index[:, nodes]
    way = np.linalg.norm((nearest - np.argwhere(nodes).T) * shape[:, None], axis=0) * step[0]
    return nearest, way


def covered_cells(exact, reach):
    """Return a mask (n - 1,) * 3 of the cells whose nodes within ``reach`` are all exact."""
    size = len(exact) - 1
    for axis in range(3):
        grown = np.ones([n - (k == axis) for k, n in enumerate(exact.shape)], bool)
        for shift in range(-reach, 2 + reach):
            index = np.clip(np.arange(size) + shift, 0, size)
            grown &= np.take(exact, index, axis=axis)
        exact = grown
    return exact

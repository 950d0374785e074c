"""Draws training and held-out points with exact labels, one shard at a time.

A stratum is the set of points drawn by one rule. The contents of its shard k depend
only on the seed, the stratum and k. Shards can therefore be drawn one at a time, and
the number of threads does not affect the result.
"""

from copy import copy

import numpy as np

from pandis.base.streams import generator
from pandis.engine.bvh import TIED
from pandis.pipeline.geometry.sampling import PROBE_DEPTHS
from pandis.pipeline.run.ask.options import SampleOptions
from pandis.pipeline.run.records.samples import SamplesRecord

STRATA = (
    "surface", "offset", "shallow", "penetration", "bent", "core", "box", "held-out", "near",
    "volume",
)  # fmt: skip
#: Number of each stratum's random stream. Fresh points have the numbers from `_FRESH` on.
_STREAMS = dict(zip(STRATA, (*range(8), 16, 17), strict=True))
_FRESH = 8
#: Half of how much larger than the mesh's bounding box the box of `volume` is, unit frame.
MARGIN = 0.1
#: Depth range (unit frame) of the shallow stratum: from just outside the surface to below the
#: shallow probes.
SHALLOW = (-0.001, 0.0115)
#: Largest depth (unit frame) of the core stratum, along the inward normal.
DEEPEST = 1.0
#: Number of points that are drawn, labelled and stored at once.
SHARD = 1 << 16

COLUMNS = {
    "points": ((3,), np.float32),
    "distance": ((), np.float32),
    "normal": ((3,), np.float32),
    "tied": ((), np.uint8),
    "stratum": ((), np.uint8),
    "face": ((), np.int32),
    "barycentrics": ((2,), np.float32),
    "offset": ((), np.float32),
}


class Strata:
    """Training and held-out points of a mesh.

    Parameters
    ----------
    body : pandis.pipeline.geometry.body.Body
    options : pandis.pipeline.run.ask.options.SampleOptions
    seed : int
    as_stored : bool
        Whether points on the surface have the distance that rounding gave them, in place of 0.

    Attributes
    ----------
    ranges : dict of str to [int, int]
        For each stratum, the index of its first point and the index one past its last.
    count : int
    """

    def __init__(self, body, options, seed, *, as_stored=False):
        self.body, self.options, self.seed = body, options, seed
        self.as_stored = as_stored
        self.engine = body.distance
        counts = {
            "surface": options.surface,
            "offset": options.offsets,
            "shallow": options.shallow,
            "penetration": options.penetration,
            "bent": options.bent,
            "core": options.core,
            "box": options.box,
            "held-out": options.held_out,
            "near": options.near,
            "volume": options.volume,
        }
        ends = np.cumsum([0, *(counts[name] for name in STRATA)]).tolist()
        self.ranges = {name: [ends[k], ends[k + 1]] for k, name in enumerate(STRATA)}
        self.count = ends[-1]

    @classmethod
    def of(cls, body, samples):
        """Return the strata of a body with the options and seed of a samples artifact."""
        law = dict(SamplesRecord.of(samples).law)
        seed = law.pop("seed")
        return cls(body, SampleOptions(**law), seed)

    def asking(self, engine):
        """Return a copy of these strata that labels points with another engine."""
        strata = copy(self)
        strata.engine = engine
        return strata

    def columns(self):
        """Return the shapes, types and chunks of all arrays, for `ArtifactWriter`."""
        return {
            name: {
                "shape": (self.count, *shape),
                "dtype": kind,
                "chunks": (min(SHARD, self.count), *shape),
            }
            for name, (shape, kind) in COLUMNS.items()
        }

    def attributes(self):
        """Return the attributes stored with the arrays."""
        law = self.options.model_dump() | {"seed": self.seed}
        return SamplesRecord(strata=self.ranges, law=law).attributes()

    def shards(self, progress):
        """Yield the arrays of each shard in turn.

        Points are float32 in the unit frame. Distances and normals are exact for these float32
        points, and are themselves rounded to float32 when stored. ``tied`` marks points with two
        closest points on the surface; their normals are arbitrary.

        Parameters
        ----------
        progress : pandis.base.progress.Progress
        """
        report, done = progress("points", self.count), 0
        for index, (name, (low, high)) in enumerate(self.ranges.items()):
            for shard, start in enumerate(range(0, high - low, SHARD)):
                rng = generator(self.seed, _STREAMS[name], shard)
                size = min(SHARD, high - low - start)
                yield self._label(index, self._draw(name, rng, start, size=size, total=high - low))
                done += size
                report.update(done)

    def arrays(self, progress):
        """Return the concatenated arrays of all shards, as in a samples artifact."""
        shards = list(self.shards(progress))
        return {
            name: np.concatenate([shard[name] for shard in shards]).astype(kind)
            for name, (_, kind) in COLUMNS.items()
        }

    def fresh(self, block, size):
        """Draw new training points, in the same proportions as the stored ones.

        Parameters
        ----------
        block : int
            Index of the block; its points do not depend on earlier draws.
        size : int

        Returns
        -------
        ndarray, shape (about size, 7), float32
            Points, distances, normals; unit frame.
        """
        drawn, trained = {}, self.count - self.options.held_out
        for name, (low, high) in self.ranges.items():
            count = round(size * (high - low) / trained)
            if name != "held-out" and count:
                rng = generator(self.seed, _FRESH + _STREAMS[name], block)
                drawn[name] = self._draw(name, rng, 0, size=count, total=count)
        # label all at once, because a GPU is slow on small batches
        points = np.concatenate([of[0] for of in drawn.values()]).astype(np.float32)
        labels = self.engine.label(points.astype(np.float64), ties=False)
        rows = np.empty((len(points), 7), np.float32)
        rows[:, :3], rows[:, 3], rows[:, 4:] = points, labels.distance, labels.normal
        if "surface" in drawn:  # these rows come first
            _, _, face, barycentrics = drawn["surface"]
            rows[: len(face), 3] = 0
            rows[: len(face), 4:] = self.body.surface.at(face, barycentrics)[1]
        return rows

    def _draw(self, stratum, rng, start, *, size, total):
        """Return points, offsets along the normal, faces and barycentrics."""
        options, index = self.options, start + np.arange(size)
        scale = np.array(options.scales)[index % len(options.scales)]
        if stratum in ("box", "volume"):
            low, high = -np.ones(3), np.ones(3)
            if stratum == "volume":
                corners = self.body.corners
                low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
            nowhere = np.full(size, -1, np.int32), np.zeros((size, 2), np.float32)
            return rng.uniform(low, high, (size, 3)), np.zeros(size), *nowhere
        if stratum in ("surface", "near"):
            offset = np.zeros(size)
        elif stratum == "offset":
            offset = rng.normal(0, scale)
        elif stratum == "shallow":
            offset = -rng.uniform(*SHALLOW, size)
        elif stratum == "held-out":
            offset = -rng.uniform(0, np.array(list(PROBE_DEPTHS.values()))[index % 2])
        elif stratum == "core":
            offset = rng.random(size)  # position in the depth range (0 to 1), logarithmic
        else:
            offset = -rng.uniform(0, options.depth, size)
        drawn = self.body.surface.draw(size, rng, start, total=total, bent=stratum == "bent")
        points, normals, face, barycentrics = drawn
        if stratum == "core":
            offset = -(options.depth ** (1 - offset)) * _way(points, -normals) ** offset
        if stratum == "near":
            points = points + scale[:, None] * rng.normal(0, 1, (size, 3))
        return points + offset[:, None] * normals, offset, face, barycentrics

    def _label(self, index, drawn):
        points, offset, face, barycentrics = drawn
        points = points.astype(np.float32)
        labels = self.engine.label(points.astype(np.float64))
        distance, normal = labels.distance, labels.normal
        if STRATA[index] == "surface":
            # by construction the points are on the surface, up to rounding of coordinates
            distance = distance if self.as_stored else np.zeros(len(points))
            normal = self.body.surface.at(face, barycentrics)[1]
        return {
            "points": points,
            "distance": distance,
            "normal": normal,
            "tied": (labels.flags & TIED) > 0,
            "stratum": np.full(len(points), index),
            "face": face,
            "barycentrics": barycentrics,
            "offset": offset,
        }


def _way(points, direction):
    """Return distances (n,) of points along a direction to the box boundary, at most `DEEPEST`."""
    with np.errstate(divide="ignore"):
        way = (np.copysign(1.0, direction) - points) / direction
    return np.minimum(np.where(direction == 0, np.inf, way).min(axis=1), DEEPEST)

"""Finds how many bits and faces a compact mesh needs to meet a limit on bytes or the error."""

from functools import cached_property
from itertools import chain
from math import inf

from pandis.base.errors import PandisError
from pandis.pipeline.geometry.measure import promise
from pandis.pipeline.kinds.compact.packing import (
    bound_deviation,
    compare_sides,
    describe,
    limit_queries,
    pack_body,
    size_of,
)
from pandis.pipeline.kinds.compact.reference import CompactField
from pandis.pipeline.kinds.compact.spec import BITS, KIND
from pandis.pipeline.kinds.sizing import Candidate, points_of, sizing_of
from pandis.pipeline.mesh.tools import ToolError, call
from pandis.pipeline.mesh.topology import edges_of
from pandis.pipeline.run.job.artifact import Artifact

#: Bits at which rounding causes far less error than removing faces.
ENOUGH_BITS = 14
#: With fewer faces, this many bits are tried first. Two are added at a time while the error falls.
_FEWEST_BITS = 12
#: Budgets in bytes that are tried, in increasing order, if the target sets no limit on bytes.
_BYTES = tuple(12_500 * 2**k for k in range(16))
#: Maximum number of simplifications to fit a mesh into a budget in bytes.
_ROUNDS = 6
#: Limits of one simplification.
_LIMITS = {"seconds": 900.0, "memory_gb": 8.0}


class Packer:
    """Makes compact meshes of one body.

    Parameters
    ----------
    points : pandis.pipeline.geometry.points.Points
        Points of the body, on which candidates are compared.
    seed : int
        Seed of the points at which sides are compared.
    log : pandis.base.progress.Log
    """

    def __init__(self, points, seed, log):
        self.body, self.points, self.seed, self.log = points.body, points, seed, log
        self._whole = {}

    def within(self, budget):
        """Return the `Candidate` of least error that fits into a budget in bytes, or None.

        A budget of None is unlimited.

        If all faces fit with ENOUGH_BITS, the candidate has all faces, and the most bits with which
        inside and outside are right: very fine lattices separate sheets that single precision
        cannot. Otherwise meshes with fewer faces are tried, too. Quadric simplification removes
        faces where the surface is flat.
        """
        budget = inf if budget is None else budget
        most = self._most_bits(budget)
        if most and most.field.record.bits >= ENOUGH_BITS:
            fewer = range(most.field.record.bits - 1, ENOUGH_BITS - 1, -1)
            packed = filter(None, map(self._packed, fewer))
            tried = ((inf, self._candidate(*one)) for one in packed)
            return self._first_sound(chain([(self._error(most), most)], tried))
        tried = [(self._error(most), most)] if most else []
        tried += self._climb(budget)
        return self._first_sound(sorted(tried, key=lambda one: one[0]))

    def _error(self, candidate):
        return promise(candidate.force, self.points.choosing)[0]["mean"]

    def _climb(self, budget):
        """Return (error, candidate) pairs with fewer faces, adding bits while the error falls."""
        tried = []
        for bits in range(_FEWEST_BITS, BITS[1] + 1, 2):
            candidate = self._fewer_faces(bits, budget)
            if candidate is None:
                continue
            tried.append((self._error(candidate), candidate))
            if len(tried) > 1 and tried[-1][0] >= tried[-2][0]:
                break
        return tried

    def _first_sound(self, tried):
        """Return the first candidate that gets every side right; None if none does."""
        for error, candidate in tried:
            record = bound_deviation(self.body, candidate.arrays, candidate.field.record)
            known = f"; mean error of the force {error:.2g}" if error < inf else ""
            self.log(f"{describe(candidate.arrays, record)}{known}")
            record = limit_queries(candidate.arrays, record)
            try:
                compare_sides(self.body, candidate.arrays, record, seed=self.seed)
            except PandisError as wrong:
                self.log(f"turned down: {wrong}")
                continue
            return self._candidate(candidate.arrays, record)
        return None

    def _candidate(self, arrays, record):
        attributes = record.attributes()
        frame = self.body.frame.attributes()
        artifact = Artifact(KIND.name, arrays, attributes | frame)
        return Candidate(CompactField(f"{KIND.name}-auto", artifact), arrays, attributes)

    def _packed(self, bits):
        """Return arrays and record of the whole mesh with this many bits; None if packing fails."""
        if bits not in self._whole:
            try:
                self._whole[bits] = pack_body(self.body, bits)
            except PandisError:
                self._whole[bits] = None
        return self._whole[bits]

    def _most_bits(self, budget):
        """Return the candidate with all faces and the most bits that fit; None if none do."""
        low, high = BITS[0] - 1, BITS[1]
        while low < high:  # more bits take more bytes
            bits = (low + high + 1) // 2
            packed = self._packed(bits)
            if packed is None or size_of(packed[0]) <= budget:
                low = bits
            else:
                high = bits - 1
        packed = self._packed(low) if low >= BITS[0] else None
        return self._candidate(*packed) if packed else None

    def _fewer_faces(self, bits, budget):
        """Return a candidate with as many faces as fit with this many bits, or None."""
        packed, surface = self._packed(bits), (self.body.corners, self.body.faces)
        for rounds in range(_ROUNDS + 1):
            if packed is None:
                return None
            size = size_of(packed[0])
            if size <= budget:
                return self._candidate(*packed)
            if rounds == _ROUNDS:
                return None
            # with fewer faces, each is larger and needs more bits
            count = int(0.995 * len(surface[1]) * budget / size)
            try:
                surface = call("simplify", *surface, count=count, **_LIMITS)
                if not edges_of(surface[1]).balanced:
                    self.log(f"simplified to {len(surface[1]):,} faces, the mesh is not closed")
                    return None
                packed = pack_body(self.body, bits, surface)
            except (ToolError, PandisError) as error:
                self.log(f"at {count:,} faces: {error}")
                return None


class CompactSizing:
    """Finds the bits and faces of a compact mesh, for `compact-auto`.

    Parameters
    ----------
    points : pandis.pipeline.geometry.points.Points
    task : pandis.pipeline.run.ask.kind.SearchTask
    log : pandis.base.progress.Log
    """

    def __init__(self, points, task, log):
        self.body, self.points, self.target, self.log = points.body, points, task.target, log
        self.packer = Packer(points, task.seed, log)

    @cached_property
    def _limits(self):
        return self.points.limits(self.target)

    def find(self):
        """Return arrays and attributes of the compact mesh; ``sizing`` lists the tried sizes.

        Raises
        ------
        PandisError
            No compact mesh fits into the budget in bytes, or meets the limits on the error.
        """
        tried = []
        budgets = _BYTES if self.target.bytes is None else [self.target.bytes]
        for budget in budgets:
            candidate = self.packer.within(budget)
            if candidate is None:
                continue
            limits = self._limits if self.target.bytes is None else None
            measured = self.points.measure(candidate.force, limits)
            tried.append((size_of(candidate.arrays), measured))
            self.log(f"compact-auto: {self.points.describe(measured.figures)}")
            if not measured.why:
                return candidate.arrays, candidate.attributes | {
                    "sizing": sizing_of(self.target, tried)
                }
            record = candidate.field.record
            if record.bits == BITS[1] and record.faces == len(self.body.faces):
                break  # no compact mesh is more accurate
        raise PandisError(self._refusal(tried))

    def _refusal(self, tried):
        what = "compact-auto (bake.auto.compact)"
        if not tried:
            budget = self.target.bytes
            fits = f" that fits into {budget:,} bytes" if budget else ""
            return f"{what}: no compact mesh{fits} gets the side of every point right"
        size, best = min(tried, key=lambda one: one[1].excess)
        return (
            f"{what}: no compact mesh meets {self.points.describe_limits(self._limits)}; the "
            f"nearest, with {size:,} bytes, {best.why}: relax the limits"
        )


def build(job):
    """Find the bits and faces of one mesh, and write ``compact-auto.zarr.zip``.

    Raises
    ------
    PandisError
        See `CompactSizing.find`.
    """
    points = points_of(job)
    arrays, attributes = CompactSizing(points, job.options, job.log).find()
    job.write("compact", arrays, attributes | points.body.frame.attributes())

"""Repairs a mesh until it is closed, manifold and oriented outward, or reports its faults.

The rungs of the repair ladder are tried in order until the mesh is valid. The mesh is
diagnosed after each rung. A result is kept only if it passes the rung's test (usually:
fewer faults) and, from ``fill`` on, stays within the deviation budget. The rungs are:

======== ====================================================================
clean    weld, drop degenerate and duplicate faces, unfold, orient outward,
         split contacts; lossless
union    exact union of shells that cross or overlap
fill     fill holes with a small rim, without adding vertices
meshfix  MeshFix on every component
remesh   marching cubes where the winding number is one half
wrap     alpha wrap
solid    with ``solid: always``, in place of the last three: the surface around what
         a person would call the solid, walls invented where it is open
======== ====================================================================
"""

import numpy as np

from pandis.base.arrays import Faces, Vertices
from pandis.base.errors import PandisError, RepairError
from pandis.pipeline.mesh.deviation import Surface, provenance
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.ladder import Ladder
from pandis.pipeline.mesh.nesting import signed_volumes
from pandis.pipeline.mesh.openings import THICKEN, advice, large_holes, loose_pieces
from pandis.pipeline.mesh.processes import CpuTime
from pandis.pipeline.mesh.solidify import solidify, with_solid
from pandis.pipeline.mesh.topology import compact, components, edges_of, one_sided, used_vertices

RUNGS = ("clean", "union", "fill", "meshfix", "remesh", "wrap")
#: Octree levels that `remesh` tries. Their cells are 1.1/128 and 1.1/256 of the longest side.
REMESH_LEVELS = (7, 8)
#: Vertices are coplanar if their smallest singular value is at most this share of the largest.
FLAT = 1e-9
#: A mesh is taken to consist of sheets without thickness if more than this share of its faces are
#: duplicates.
SHEETS = 0.2
#: Alpha and offset of `wrap`, as shares of the diagonal.
WRAP_ALPHA, WRAP_OFFSET = 0.005, 0.0002


def repair(vertices: Vertices, faces: Faces, options, *, seed, log=print):
    """Repair a mesh with as few rungs of the ladder as needed.

    A mesh that is valid as read is returned bitwise unchanged, but without its unreferenced
    vertices.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3), float64, mesh units
    faces : ndarray, shape (F, 3), int64
    options : pandis.pipeline.run.ask.options.MeshOptions
    seed : int
    log : pandis.base.progress.Log

    Returns
    -------
    arrays : dict
        ``vertices`` (V, 3), ``faces`` (F, 3) int32, and per face ``origin`` and
        ``deviation``: see `pandis.pipeline.mesh.deviation.provenance`.
    record : dict
        ``before`` and ``after`` (diagnoses), ``rungs`` (every attempt, with tool,
        parameters and outcome), ``deviation``, ``solid`` (what was invented, or None).

    Raises
    ------
    RepairError
        The mesh is open or remains invalid (the message contains the diagnosis and an option
        to proceed), or a rung exceeded its limits.
    """
    before = diagnose(vertices, faces)
    log(f"{before.vertices:,} vertices, {before.faces:,} faces; faults: {before.faults()}")
    ladder = Ladder(vertices, faces, options, seed, log, now=before)
    if before.valid and before.unreferenced_vertices:
        ladder.vertices, ladder.faces = compact(vertices, faces)
        ladder.now = diagnose(ladder.vertices, ladder.faces)
    solid = None
    if not before.valid:
        solid = _repaired(ladder, vertices, faces)
    record = {
        "before": before.attributes(),
        "faults_before": before.faults(),
        "after": ladder.now.attributes(),
        "rungs": ladder.rungs,
        "deviation": ladder.deviation,
        "solid": solid and solid.attributes(),
    }
    origin = np.zeros(len(ladder.faces), np.uint8), np.zeros(len(ladder.faces), np.float32)
    if ladder.source:
        result = Surface(ladder.vertices, ladder.faces)
        origin = provenance(ladder.source, result, ladder.reference, cell=solid and solid.cell)
    arrays = {
        "vertices": ladder.vertices,
        "faces": ladder.faces.astype(np.int32),
        "origin": origin[0],
        "deviation": origin[1],
    }
    return arrays, record


def _repaired(ladder, vertices, faces):
    """Climb, and make a solid if that fails and is wanted; return what was invented, or None."""
    always, start = ladder.options.solid == "always", ladder.state()
    if always:
        ladder.cpu = CpuTime(ladder.options.solid_after)
    try:
        climb(ladder)
        if always and ladder.options.open == "refuse":  # else caps were asked for
            _demand_own_walls(ladder)
    except PandisError as error:
        if always:
            ladder.go_back(start)
            return solidify(ladder, vertices, faces, why=str(error).partition(". ")[0])
        if not isinstance(error, RepairError):
            raise
        raise with_solid(error, vertices, faces, options=ladder.options) from None
    return None


def _demand_own_walls(ladder):
    """Raise if caps are too large a share of a mesh for which a solid would be made otherwise."""
    caps = ladder.deviation["to_source"]["caps"]
    if caps > ladder.options.solid_share:
        raise RepairError(
            f"caps are {100 * caps:.2g} % of the surface, and mesh.solid_share is "
            f"{ladder.options.solid_share:g}"
        )


def climb(ladder):
    """Try the rungs in order, until the mesh is valid.

    Raises
    ------
    RepairError
        As from `repair`.
    """
    ladder.source = Surface(ladder.vertices, ladder.faces)
    flat = _is_flat(ladder.vertices[used_vertices(ladder.faces)])
    paired = ladder.now.duplicate_faces > SHEETS * ladder.now.faces
    _clean(ladder)
    ladder.reference = Surface(ladder.vertices, ladder.faces)
    if _without_inside(ladder, flat):
        _thicken(ladder)
        return
    share, edges = ladder.options.small_hole, ladder.options.max_hole_edges
    if ladder.now.boundary_edges and ladder.options.open != "thicken":
        _part_with_loose(ladder)
    if ladder.now.boundary_edges and not ladder.closes_holes:
        holes = large_holes(ladder.vertices, ladder.faces, share, max_edges=edges)
        if holes and ladder.options.open == "thicken":
            _thicken(ladder)
            return
        if holes:
            raise _too_open(ladder, holes, paired)
    _settle(ladder)
    if not ladder.now.valid and ladder.allows("fill"):
        _fill(ladder)
    if not ladder.now.valid and ladder.allows("meshfix"):
        ladder.attempt("meshfix", "meshfix", ladder.better)
        _settle(ladder)
    for level in REMESH_LEVELS:
        if not ladder.now.valid and ladder.allows("remesh"):
            ladder.attempt("remesh", "remesh", ladder.valid_only, level=level)
    if not ladder.now.valid and ladder.allows("wrap"):
        ladder.attempt("wrap", "wrap", ladder.valid_only, alpha=WRAP_ALPHA, offset=WRAP_OFFSET)
    if not ladder.now.valid:
        raise _refusal(ladder)
    if ladder.deviation is None:
        reason = ladder.within_budget(ladder.vertices, ladder.faces, None)
        ladder.deviation = ladder._measured
        if reason is not None:
            raise _refusal(ladder, reason)


def _is_flat(vertices):
    """Return whether vertices (n, 3) are coplanar."""
    if len(vertices) < 4:
        return True
    sizes = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return bool(sizes[2] <= FLAT * sizes[0])


def _without_inside(ladder, flat):
    """Return whether a mesh has no inside and must be thickened into a wall.

    Raises
    ------
    RepairError
        It has no inside, and `mesh.open` is not ``thicken``.
    """
    turned = int(one_sided(ladder.faces).sum())
    if not (flat or turned):
        return False
    if ladder.options.open == "thicken":
        return True
    what = "the mesh lies in one plane: it has no volume, and so no inside"
    if turned:
        what = (
            f"{turned:,} of {len(ladder.faces):,} faces are a closed surface with one side only, "
            "like a Klein bottle. Such a surface has no inside"
        )
    raise RepairError(f"{what}. {THICKEN}", open="thicken")


def _part_with_loose(ladder):
    """Remove and log loose pieces if holes are to be capped.

    Raises
    ------
    RepairError
        There are loose pieces, and `mesh.open` is ``refuse``.
    """
    share, edges = ladder.options.small_hole, ladder.options.max_hole_edges
    debris, inside = loose_pieces(ladder.vertices, ladder.faces, share, max_edges=edges)
    loose, notes = debris | inside, []
    for which, called in ((debris, "loose pieces that enclose nothing"),
                          (inside, "open pieces inside closed parts")):  # fmt: skip
        if which.any():
            count = len(np.unique(components(ladder.faces)[0][which]))
            notes.append(f"{count} {called} ({which.sum():,} of {len(loose):,} faces)")
    if not notes:
        return
    what = " and ".join(notes)
    if ladder.options.open == "cap":
        ladder.leave_out(loose, what)
        return
    option, sentence = "cap", ""
    if not loose.all():
        option, sentence = advice(ladder.vertices, ladder.faces[~loose], ladder.seed)
    if option == "cap":
        sentence = (
            "To leave these out and close the holes of the rest, set `mesh: {open: cap}` for this "
            "mesh"
        )
    raise RepairError(
        f"the mesh is open: {ladder.now.faults()}; there are {what}. {sentence}", open=option
    )


def _orient(ladder):
    """Orient faces outward, and log how much solid volume becomes a cavity."""
    before = ladder.faces
    accepted = ladder.attempt("clean", "orient", ladder.not_worse, nested=ladder.options.nested)
    if not accepted or len(before) != len(ladder.faces):
        return
    label, count = components(ladder.faces)
    was, now = (
        signed_volumes(ladder.vertices, f, label, count=count) for f in (before, ladder.faces)
    )
    hollow = (was > 0) & (now < 0) & edges_of(ladder.faces).closed
    if hollow.any():
        ladder.log(
            f"a solid inside another becomes a cavity, as mesh.nested requires: {hollow.sum()} "
            f"components, {was[hollow].sum():.4g} of {was[was > 0].sum():.4g} cubic mesh units; "
            "`mesh: {nested: solid}` keeps it solid"
        )


def _clean(ladder):
    """Weld vertices, drop degenerate and duplicate faces, and orient the rest outward."""
    if not ladder.allows("clean"):
        return
    ladder.attempt("clean", "clean", lambda *_: None)
    if not ladder.now.closed and ladder.options.weld:
        tolerance = ladder.options.weld * ladder.now.diagonal
        ladder.attempt("clean", "clean", ladder.not_worse, tolerance=tolerance)
    if not ladder.now.valid:
        _orient(ladder)


def _settle(ladder):
    """Unite overlapping shells and split contacts, as long as faults decrease.

    If split faces still cross at the end, try again with ``straight`` splitting.
    """
    before = ladder.state()
    _settle_by(ladder)
    crossing = not ladder.now.valid and ladder.now.self_intersections
    if crossing and ladder.has_kept("split", before):
        first = ladder.state()
        ladder.go_back(before)
        _settle_by(ladder, straight=True)
        if not ladder.now.valid and ladder.now.rank >= first.now.rank:
            ladder.go_back(first)


def _settle_by(ladder, **parting):
    for _ in range(3):
        rank = ladder.now.rank
        if ladder.now.valid:
            return
        if ladder.allows("clean"):
            ladder.attempt("clean", "clean", ladder.not_worse)
            _orient(ladder)
        now = ladder.now
        walls = now.nonmanifold_edges and now.unbalanced_edges
        if walls and not now.boundary_edges and not now.self_intersections:
            _leave_walls_out(ladder)
            now = ladder.now
        crossing = now.self_intersections or now.odd_windings or now.duplicate_faces
        if crossing and ladder.allows("union") and edges_of(ladder.faces).balanced:
            ladder.attempt("union", "union", _balanced_only)
        torn = ladder.now.nonmanifold_edges or ladder.now.nonmanifold_vertices
        if torn and ladder.allows("clean"):
            ladder.attempt("clean", "split", _manifold_only, **parting)
        if ladder.now.rank >= rank:
            return


def _leave_walls_out(ladder):
    """Remove walls between the cells of one body; deviation is then measured without them."""
    before = ladder.vertices[ladder.faces]

    def accept(vertices, faces, diagnosis):
        # every remaining face must be one of the given faces: nothing may move
        places = {tuple(sorted(map(tuple, corners))) for corners in before.tolist()}
        left = (tuple(sorted(map(tuple, corners))) for corners in vertices[faces].tolist())
        if not all(corners in places for corners in left):
            return "faces have moved"
        return _balanced_only(vertices, faces, diagnosis)

    if ladder.allows("union") and ladder.attempt("union", "skin", accept):
        ladder.source = ladder.reference = Surface(ladder.vertices, ladder.faces)
        ladder.log(f"left out: {len(before) - len(ladder.faces):,} faces between cells of one body")


def _balanced_only(vertices, faces, diagnosis):
    del vertices, diagnosis
    return None if edges_of(faces).balanced else "the union is open"


def _manifold_only(vertices, faces, diagnosis):
    del vertices, faces
    torn = diagnosis.nonmanifold_edges + diagnosis.nonmanifold_vertices
    return "still not manifold" if torn else None


def _fill(ladder):
    torn = ladder.now.nonmanifold_edges or ladder.now.nonmanifold_vertices
    if ladder.now.boundary_edges and not torn:
        ladder.attempt("fill", "fill", ladder.better)
        _settle(ladder)


def _thicken(ladder):
    """Turn the surface into a wall: wrap it on both sides at an offset."""
    half = ladder.options.thickness / 2

    def accept(vertices, faces, diagnosis):
        if not diagnosis.valid:
            return "not valid"
        return ladder.within_budget(vertices, faces, diagnosis, allowance=half)

    alpha = min(WRAP_ALPHA, ladder.options.thickness)
    if not ladder.allows("wrap") or not ladder.attempt(
        "wrap", "wrap", accept, alpha=alpha, offset=half
    ):
        raise _refusal(ladder)


def _too_open(ladder, holes, paired):
    """Return the error about holes that are too large to be filled without permission."""
    option, sentence = advice(ladder.vertices, ladder.faces, ladder.seed)
    if paired:
        option = "thicken"
        sentence = f"Its faces come in pairs, back to back: sheets without thickness. {THICKEN}"
    return RepairError(
        f"the mesh is open: {ladder.now.faults()}. Holes too large to fill without permission: "
        f"{len(holes)} (the widest rim is {holes[0]['rim']:.3g} times the diagonal of "
        f"its part, mesh.small_hole is {ladder.options.small_hole:g}). This may be a surface "
        f"without an inside. {sentence}",
        open=option,
    )


def _refusal(ladder, reason=None):
    """Return the error about a mesh that no rung has repaired."""
    tried = "; ".join(
        f"{r['operation']}: {r['reason']}" for r in ladder.rungs if r["reason"] is not None
    )
    missing = [rung for rung in RUNGS if not ladder.allows(rung)]
    todo, option = "repair it in a mesh editor", {}
    if missing:
        option = {"rungs": list(RUNGS)}
        todo = f"allow the omitted rungs (mesh.rungs: add {', '.join(missing)})"
    elif ladder.options.open == "cap":
        option = {"open": "thicken"}
        todo = "turn it into a wall of mesh.thickness: set `mesh: {open: thicken}` for this mesh"
    state = f"the mesh remains invalid: {ladder.now.faults()}"
    if reason:
        state = f"the repaired mesh differs too much from the source: {reason}"
    return RepairError(f"{state}. Tried: {tried or 'nothing'}. To proceed, {todo}", **option)

"""The last rung: a solid for a mesh that no exact rung repairs, and the promise of one."""

import numpy as np

from pandis.base.errors import PandisError, RepairError
from pandis.pipeline.mesh.deviation import SAMPLES, Surface, summary
from pandis.pipeline.mesh.diagnosis import diagnose
from pandis.pipeline.mesh.solid import make_solid, rules_of
from pandis.pipeline.mesh.topology import compact

#: Cells along the longest side of the solid that is tried before it is recommended.
_TRIAL = 64


def solidify(ladder, vertices, faces, *, why):
    """Replace the mesh of a ladder by its solid.

    Parameters
    ----------
    ladder : pandis.pipeline.mesh.ladder.Ladder
    vertices, faces : ndarray
        The mesh as read.
    why : str
        Why no exact rung was enough.

    Returns
    -------
    pandis.pipeline.run.records.mesh.SolidFacts
        What was invented.

    Raises
    ------
    RepairError
        The solid is not valid.
    """
    vertices, faces = compact(vertices, faces)
    rules = rules_of(ladder.options, vertices)
    ladder.log(f"solid, because {why}")
    solid = make_solid(vertices, faces, rules, log=ladder.log)
    now = diagnose(solid.vertices, solid.faces)
    entry = {"rung": "solid", "operation": "solid", "parameters": rules._asdict()}
    ladder.note(entry, None if now.valid else "not valid", now)
    if not now.valid:
        raise RepairError(f"the solid is not valid: {now.faults()}. Please report this mesh")
    ladder.vertices, ladder.faces, ladder.now = solid.vertices, solid.faces, now
    ladder.source = ladder.reference = Surface(vertices, faces)
    result = Surface(solid.vertices, solid.faces)
    ladder.deviation = _deviation(ladder.source, result, solid.facts.cell, seed=ladder.seed)
    return solid.facts.model_copy(update={"why": why})


def _deviation(source, result, cell, *, seed):
    """Measure both ways; what lies farther than a cell inside or off the other is counted apart."""
    rng = np.random.default_rng(seed)
    points, _ = source.sample(SAMPLES, rng, np.ones(len(source.faces), bool))
    distance = result.distance(points)
    hidden = np.zeros(len(points), bool)
    deep = np.flatnonzero(distance > cell)
    hidden[deep] = result.windings(points[deep]) > 0.5
    back, _ = result.sample(SAMPLES, rng, np.ones(len(result.faces), bool))
    to_source = source.distance(back)
    caps = to_source > cell
    return {
        "to_result": summary(distance[~hidden], SAMPLES) | {"hidden": float(hidden.mean())},
        "to_source": summary(to_source[~caps], SAMPLES) | {"caps": float(caps.mean())},
        "untouched": 0.0,
    }


def with_solid(error, vertices, faces, *, options):
    """Return a refusal that recommends `mesh.solid`, if a coarse solid of the mesh is valid.

    Parameters
    ----------
    error : RepairError
    vertices, faces : ndarray
        The mesh as read.
    options : pandis.pipeline.run.ask.options.MeshOptions

    Returns
    -------
    RepairError
    """
    try:
        vertices, faces = compact(vertices, faces)
        rules = rules_of(options, vertices)._replace(cells=_TRIAL)
        solid = make_solid(vertices, faces, rules, log=lambda text: None)
        valid = diagnose(solid.vertices, solid.faces).valid
    except (PandisError, ArithmeticError, MemoryError):
        valid = False
    if not valid:
        return error
    return RepairError(
        f"{error}. Or set `mesh: {{solid: always}}` for this mesh: it can be one closed surface "
        f"with {100 * solid.facts.invented:.3g} % of its area invented and "
        f"{100 * solid.facts.sheets:.3g} % thickened (tried at {_TRIAL} cells)",
        solid="always",
    )

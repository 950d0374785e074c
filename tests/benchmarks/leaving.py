"""Whether a proxy always comes along, judged by a walk that shares no code with it.

Usage: [PANDIS_MESHES=FOLDER] .venv/bin/python tests/benchmarks/leaving.py [WAYS [SEED [KINDS]]]

A probe is pressed, slid and led away on objects of 100 mm: corners of 3 to 8 walls turned anyhow,
grooves, slits, needles, a torus, and, where PANDIS_MESHES is set, three scans, on every kind of
field or on KINDS (`exact,compact-16`); the networks are small ones that were trained a moment,
but `pandis-exact-STEPS` is as large as a configuration's. Radius, friction, budget and the length
of a tick are drawn for each way; every eighth object moves. Then the probe rests as long as `slide`
allows for the way that is left, and 50 ms more. What counts against the contact is

    held     50 ms and the time that `slide` allows are over, and the straight way from the proxy
             to the probe is free; however few looks there are
    left     it is late, and still behind two seconds later
    late     a walk in small steps from the proxy towards the probe, outside of the field's own
             surface, comes nearer than friction explains, though the proxy had time: more than
             50 ms (or 600 looks, if that is longer) in which it went neither at `slide` nor at
             4 um for each look that its budget allows
    passes   a proxy lay more than 0.05 mm below the field's own surface, or below where it began
    bounds   a force changed by more than the stiffness allows for the ways of a tick

`slow` proxies would be late without the allowance for looks, and are counted, too. It matters
below 12,500 looks a second, which are `slide`: a budget of 24 at ticks of 1.9 ms. Those of them
that are not `held` slide around an edge or along a wall.
"""

import os
import sys
from collections import Counter

import numpy as np
import trimesh
from bodies import UNIT, field_of
from common import ROOT, SCANS, load

sys.path.insert(0, str(ROOT / "tests/helpers"))

from oracle import Solid
from pandis.base.frame import Frame
from pandis.pipeline.geometry.body import Body
from ways import SHAPES, draw, judge, told

#: Per kind of field: the share of all ways, and the largest radius (mm of 100).
KINDS = {
    "exact": (0.4, 5.0),
    "compact-16": (0.3, 5.0),
    "spline-800K": (0.1, 1.0),
    "tricubic-96": (0.1, 1.0),
    "trilinear-normal-96": (0.1, 1.0),
    "network-400": (0.1, 5.0),
}


def meshes(rng, corners):
    """Yield (name, vertices, faces, places) in the unit frame."""
    for name, make in SHAPES.items():
        for _ in range(corners if name.startswith("corner") else 1):
            mesh, places = make(rng)
            turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
            vertices = mesh.vertices @ turn.T
            frame = Frame.of_bounds(vertices.min(0), vertices.max(0))
            yield (
                name,
                frame.to_unit(vertices),
                np.asarray(mesh.faces, np.int64),
                (places, turn, frame),
            )
    for name in SCANS if os.environ.get("PANDIS_MESHES") else ():
        yield (name, *load(SCANS[name]), None)


def main(wanted=2000, seed=0, kinds=""):
    """Follow all ways; print a row for each shape and field; return whether anything was wrong."""
    rng, wrong = np.random.default_rng(seed), Counter()
    named = (kind for kind in kinds.split(",") if kind)
    asked = {kind: KINDS.get(kind, KINDS["network-400"]) for kind in named} or KINDS
    whole = sum(share for share, _ in asked.values())
    listed = list(meshes(rng, max(1, wanted // 20_000)))
    for name, vertices, faces, where in listed:
        body, solid = Body(vertices, faces.astype(np.int32), UNIT), Solid(vertices, faces)
        for kind, (share, largest) in asked.items():
            field = field_of(body, kind)
            ways = draw(solid, where, max(1, round(wanted * share / whole / len(listed))), rng)
            seen, worst = judge(field, kind, solid, ways, largest)
            wrong += seen
            print(f"{name}, {kind}: {told(seen)}, {worst:.2g} mm at most", flush=True)
    print(f"in all: {told(wrong)}")
    return any(wrong[name] for name in ("held", "left", "late", "passes", "bounds"))


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(main(*map(int, given[:2]), *given[2:3]))

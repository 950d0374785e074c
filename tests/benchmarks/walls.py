"""Whether what `fields: auto` sells of thin walls holds a proxy, judged by libigl alone.

Usage: .venv/bin/python tests/benchmarks/walls.py [--only fins] [--presses 400] [--processes 2]

Forty combinations: fins, needles, cages, plates and bent plates of 0.1 to 2 mm (of 100), at 400 and
100 N/m, each with a budget that `compact` fits into and with one that it does not. What is chosen,
by every kind that a user has (networks of 600 steps), is exported, opened again and pressed by a
proxy with the device's largest force, at points of all of the surface that is thicker than 0.02 mm.
A press is held if the proxy rests within the field's largest surface error and 0.05 mm of the wall,
on the side from which it came and where it came to. The bar: at least 30 are sold, and each of them
holds 99.5 % of its presses. The same presses on the exact field tell whether the judge is sound.
"""

import argparse
import csv
import sys
import tempfile
import time
from collections import Counter
from itertools import product
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np
import trimesh
from common import ROOT

sys.path.insert(0, str(ROOT / "tests/helpers"))

from pandis.base.errors import PandisError
from pandis.base.frame import UNIT_SIDE
from pandis.base.physical import Scale
from pandis.base.progress import Context
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.geometry.points import Points
from pandis.pipeline.judge.choice import Chooser
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import export_native
from pandis.pipeline.kinds.opening import open_field
from pandis.pipeline.run.ask.catalogue import parse_field
from pandis.pipeline.run.ask.config import MeshEntry
from pandis.pipeline.run.ask.options import NativeOptions
from pandis.pipeline.run.host.processes import each
from pandis.pipeline.run.job.artifact import Artifact
from pandis.pipeline.run.job.stage import silent_progress
from pandis.pipeline.run.plan.query_times import QueryTimes
from pandis.pipeline.run.plan.stages import STAGES, PlannedJob
from pandis.runtime.contact import Material, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from shapes import box, opened, plate, union

TABLE = ROOT / "config" / "query-times.csv"
THICKNESSES, STIFFNESSES = (0.1, 0.3, 1.0, 2.0), (400.0, 100.0)
SIZE, ERROR, STEPS = 0.1, "20 mN", 600
#: The bar: fields sold, and the share of the presses that each of them holds.
SOLD, HELD = 30, 0.995
#: Thinner walls are not pressed; a proxy rests so near, beside the field's error; so far along the
#: wall it may have slid (m).
THINNEST, MARGIN, ASIDE = 2e-5, 5e-5, 5e-4
#: Where a press begins, if there is room, the probe's way in a tick, and ticks of rest at the end.
ABOVE, TICK, STEP, REST = 3e-3, 1e-3, 5e-5, 100
#: Friction, without which a proxy slides off whatever bends away from it.
STICKS = Material(0.6, 0.6, 0.0, 0.0)
#: Surface points that errors are taken at and presses drawn from; halvings of a ball's radius.
PLACES, HALVINGS = 20_000, 40


class Combination(NamedTuple):
    """A body, its thickness (mm) and stiffness (N/m), and what its budget leaves to choose from.

    The budget is one that ``compact`` fits into; or such that `exact` is quicker, because the body
    has few faces; or only grids are quick enough; or there are no query times of compact meshes, as
    in tables of before there were any, so that grids, splines and networks are left.
    """

    shape: str
    thickness: float
    stiffness: float
    budget: str

    def __str__(self):
        return f"{self.shape} {self.thickness:g} mm {self.stiffness:g} N/m {self.budget}"


# --- bodies, mm: fine ones for fields, and coarse ones of a few hundred faces --------------------


def fins(thickness, fine):
    """Return a ball with two fins."""
    parts = [box((thickness, 100.0, 30.0), 2.0 if fine else 100.0) for _ in range(2)]
    parts[1].apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    parts[1].apply_translation([9.0, 0.0, 0.0])
    return union([trimesh.creation.icosphere(4 if fine else 1, 25.0), *parts])


def needles(thickness, fine):
    """Return a ball with fourteen needles, or six."""
    ways = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)]
    parts = []
    for way in ways if fine else ways[:3]:
        needle = box((thickness, thickness, 100.0), 2.0 if fine else 100.0)
        parts.append(needle.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), way)))
    return union([trimesh.creation.icosphere(4 if fine else 1, 25.0), *parts])


def cage(thickness, fine):
    """Return the edges of a cube."""
    bars, half = [], 50 - thickness / 2
    for axis, one, other in product(range(3), (-half, half), (-half, half)):
        bar = box(np.roll((100.0, thickness, thickness), axis), 2.0 if fine else 100.0)
        bars.append(bar.apply_translation(np.roll((0.0, one, other), axis)))
    return union(bars)


def bent(thickness, fine):
    """Return a plate, bent to a quarter of a circle."""
    radius = 50 * np.sqrt(2)
    sheet = box((radius * np.pi / 2, 60.0, thickness), 2.0 if fine else 14.0)
    x, y, z = sheet.vertices.T
    outer = radius - thickness / 2 + z
    sheet.vertices = np.column_stack([outer * np.sin(x / radius), y, outer * np.cos(x / radius)])
    return sheet


SHAPES = {
    "fins": fins,
    "needles": needles,
    "cage": cage,
    "plate": lambda thickness, fine: plate(thickness, 2.0 if fine else 25.0),
    "bent": bent,
}


def combinations():
    """Return all forty; of what `compact` does not fit into, most leave `exact`."""
    made = []
    for (i, shape), (j, thickness) in product(enumerate(SHAPES), enumerate(THICKNESSES)):
        stiffness = STIFFNESSES[(i + j) % 2]
        other = "few" if thickness < 1 else "grids"
        if thickness == 1:
            other = "few" if shape in ("cage", "plate", "bent") else "grids"
        elif thickness == 2:
            other = "networks" if shape in ("fins", "needles", "cage", "bent") else "grids"
        made += [Combination(shape, thickness, stiffness, budget) for budget in ("fits", other)]
    return made


# --- what a user gets -----------------------------------------------------------------------------


def asked(combination, body, folder):
    """Return the table of query times and the budget of a combination."""
    times, faces = QueryTimes(TABLE), len(body.faces)
    exact, compact = (times.seconds(kind, faces) for kind in ("exact", "compact"))
    budget = {"force_error": ERROR}
    if combination.budget == "fits":
        budget["bytes"] = body.bytes // 4
    elif combination.budget == "few":
        if exact >= compact:
            raise ValueError(f"{combination}: exact is no quicker with {faces} faces")
        budget["query_time"] = np.sqrt(exact * compact)
    elif combination.budget == "grids":
        budget["query_time"] = 0.7 * min(exact, compact)
    else:
        budget |= {"bytes": body.bytes - 1, "query_time": 1e-4}
        times = QueryTimes(_without_compact(folder))
    return times, budget


def _without_compact(folder):
    """Write the table of query times as it was before there were compact meshes."""
    with TABLE.open(encoding="utf-8") as stream:
        kept = [row for row in csv.reader(stream) if row[:1] != ["compact"]]
    path = Path(folder) / TABLE.name
    path.write_text("".join(",".join(row) + "\n" for row in kept), encoding="utf-8")
    return path


def choose(combination, mesh, body, folder):
    """Choose, export and open again, as a run does; returns the field, and its name and bytes."""
    times, budget = asked(combination, body, folder)
    entry = MeshEntry(
        source="walls.obj",
        fields="auto",
        budget=budget,
        device={"size": SIZE, "stiffness": combination.stiffness},
        train={"pandis-exact": {"steps": STEPS}},
    )
    task = STAGES["choose"].options(PlannedJob("choose", str(combination), entry, {}))
    points = Points(body, Scale.of(task), task.seed)
    context = Context(Path(folder) / "choice.pt", silent_progress, lambda text: None)
    arrays, attributes, finish = Chooser(points, task, times, context=context).choose()
    finish()
    attributes |= body.frame.attributes()
    held = Artifact("choice", arrays, attributes, path=Path("choice.zarr.zip"))
    spec = parse_field("auto", ["auto"])
    # exact is kept with the mesh's vertices and faces, as the mesh is
    field, options = open_field(spec, held), NativeOptions(weight_bits=task.weight_bits)
    path = Path(folder) / "auto.pandis"
    path.write_bytes(export_native(field, body, options, provenance={}, log=lambda text: None))
    chosen = attributes["choice"]
    return NativeField(path), f"{chosen['field']}, {chosen['bytes']:,} bytes", task


# --- what becomes of it under a proxy ------------------------------------------------------------


class Wall:
    """Distances, sides and thicknesses of a mesh (m), by libigl."""

    def __init__(self, vertices, faces):
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int64)

    def draw(self, count, rng):
        """Return points (n, 3) uniform by area, and their outward normals."""
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        face = rng.choice(len(area), count, p=area / area.sum())
        points = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), count), corners[face])
        return points, across[face] / area[face, None]

    def distance(self, points):
        """Return how far (n,) the surface is."""
        points = np.ascontiguousarray(points)
        square, _, _ = igl.point_mesh_squared_distance(points, self.vertices, self.faces)
        return np.sqrt(square)

    def inside(self, points):
        """Tell which points lie inside, by the winding number."""
        points = np.ascontiguousarray(points)
        return igl.winding_number(self.vertices, self.faces, points) > 0.5

    def thickness(self, feet, outward):
        """Return the diameters (n,) of the largest balls inside that touch surface points.

        Balls that touch a point lie in one another, so that halving finds the largest that nothing
        reaches into.
        """
        low, high = np.zeros(len(feet)), np.full(len(feet), SIZE / 2)
        for _ in range(HALVINGS):
            radius = (low + high) / 2
            free = self.distance(feet - radius[:, None] * outward) >= radius * (1 - 1e-9) - 1e-12
            low, high = np.where(free, radius, low), np.where(free, high, radius)
        return 2 * low

    def room(self, foot, outward):
        """Return how far above a surface point the next wall is, or infinity."""
        hits = igl.ray_mesh_intersect(foot + 1e-7 * outward, outward, self.vertices, self.faces)
        return min((way for _, way, *_ in hits or () if way > 0), default=np.inf)


def press(placed, foot, outward, force, room):
    """Press a proxy onto a surface point, straight, with a force; returns where it rests (3,)."""
    start, end = min(ABOVE, room / 2), -force / placed.stiffness
    way = np.linspace(start, end, int((start - end) / STEP) + 1)
    heights = np.concatenate([way, np.full(REST, end)])
    contact = NativeContact(placed, material=STICKS)
    return contact.follow(foot + heights[:, None] * outward, TICK).proxy[-1]


def judge(wall, feet, outward, proxies, tolerance):
    """Return what became of each press: ``held``, or what went wrong."""
    way = proxies - feet
    height = np.einsum("ij,ij->i", way, outward)
    aside = np.linalg.norm(way - height[:, None] * outward, axis=1)
    told = np.full(len(feet), "held", dtype="<U12")
    told[aside > tolerance + ASIDE] = "slid off"
    away = wall.distance(proxies)
    told[away > tolerance] = "off the wall"
    told[height < -tolerance] = "through"
    told[(away > tolerance) & wall.inside(proxies)] = "deep"
    told[~np.isfinite(proxies).all(axis=1)] = "no number"
    return told


def surface_error(field, metres, feet, outward, thickness):
    """Return a field's largest distance (m) at surface points, where it has the wall at all.

    A wall that it lacks is no error that excuses what goes through it.
    """
    there = field.query((feet - 0.45 * thickness[:, None] * outward) / metres).distance < 0
    return float(np.abs(field.query(feet / metres).distance[there]).max(initial=0)) * metres


def measure(combination, presses):
    """Return the row of a combination."""
    begun = time.perf_counter()
    found = opened(SHAPES[combination.shape](combination.thickness, combination.budget != "few"))
    body = Body.open(found.mesh)
    row = {"combination": str(combination), "faces": len(body.faces), "sold": False}
    with tempfile.TemporaryDirectory() as folder:
        try:
            field, row["chosen"], task = choose(combination, found.mesh, body, folder)
        except PandisError as refused:
            return row | {"chosen": f"refused: {refused}", "s": time.perf_counter() - begun}
        row |= {"sold": True, "choose_s": time.perf_counter() - begun}
        metres, rng = SIZE * body.frame.scale / UNIT_SIDE, np.random.default_rng(0)
        wall = Wall((body.vertices - body.frame.centre) * metres, body.faces)
        feet, outward = wall.draw(PLACES, rng)
        thickness = wall.thickness(feet, outward)
        shift = np.array(body.frame.centre) * metres  # the mesh's own origin may be elsewhere
        error = surface_error(field, metres, feet + shift, outward, thickness)
        thick = np.flatnonzero(thickness > THINNEST)
        some = thick[:presses]
        feet, outward = feet[some], outward[some]
        rooms = [wall.room(*place) for place in zip(feet, outward, strict=True)]
        exact = export_native(
            ExactField("exact", body), body, NativeOptions(), provenance={}, log=lambda text: None
        )
        files = {"told": (field, error), "exact": (NativeField(exact), 0.0)}
        for key, (file, off) in files.items():
            placed = Placed.at(file, SIZE, combination.stiffness)
            force = task.stress.force_limit
            given = zip(feet, outward, rooms, strict=True)
            rests = np.array([press(placed, foot, out, force, room) for foot, out, room in given])
            row[key] = Counter(judge(wall, feet, outward, rests, off + MARGIN).tolist())
    row |= {"presses": len(some), "error_mm": 1e3 * error, "thick": len(thick) / PLACES}
    return row | {"s": time.perf_counter() - begun}


def say(row):
    """Print the line of a combination."""
    line = f"{row['combination']:32s} {row['faces']:6d} {row['s']:5.0f} s  "
    if not row["sold"]:
        print(f"{line}{row['chosen']}", flush=True)
        return
    held, sound = (row[key]["held"] / row["presses"] for key in ("told", "exact"))
    faults = ", ".join(f"{count} {name}" for name, count in row["told"].items() if name != "held")
    print(
        f"{line}{row['chosen']:36s} error {row['error_mm']:.2g} mm, held {held:7.2%} of "
        f"{row['presses']} on {row['thick']:.0%} of the surface (exact {sound:7.2%})  {faults}",
        flush=True,
    )


def main():
    """Measure all combinations, or some, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", help="combinations whose name has this in it")
    parser.add_argument("--presses", type=int, default=400, help="of each field")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    wanted = [one for one in combinations() if given.only in str(one)]
    rows = []
    for row in each(lambda one: measure(one, given.presses), wanted, given.processes):
        say(row)
        rows.append(row)
    sold = [row for row in rows if row["sold"]]
    shares = {row["combination"]: row["told"]["held"] / row["presses"] for row in sold}
    bad = [name for name, share in shares.items() if share < HELD]
    print(f"{len(sold)} of {len(rows)} sold ({SOLD} of 40 wanted); {len(bad)} of them hold less "
          f"than {HELD:.1%} of the presses: {', '.join(bad) or 'none'}")  # fmt: skip
    print(f"by budget: {dict(Counter(row['combination'].split()[-1] for row in sold))}")


if __name__ == "__main__":
    main()

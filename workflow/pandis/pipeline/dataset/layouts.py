"""Writes a store in the layouts that others' training code reads.

Points are drawn from the stored solids, rounded to the layout's type, and labelled then, so that
labels are exact at the points as they are written. Every file with labels states their sign.
"""

import io
import tarfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pandis.base.errors import PandisError
from pandis.base.files import write_atomically
from pandis.base.frame import Frame
from pandis.base.streams import generator
from pandis.pipeline.dataset.joined import write_joined
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.mesh.topology import edges_of
from pandis.pipeline.run.plan.stages import stage_seed

#: Edges sharper than this angle (degrees) count as sharp.
_SHARP = 30.0
#: Noise of points near the surface and near sharp edges, unit frame.
_NEAR, _NEAR_EDGES = (0.005, 0.05), (0.001, 0.007, 0.02)
_POSITIVE, _OCCUPANCY = "positive outside", "1 inside, 0 outside"


class Points(NamedTuple):
    """Numbers of points that a layout is written with."""

    volume: int = 250_000
    near: int = 250_000
    surface: int = 100_000
    sharp: int = 50_000


class _Drawer:
    """Draws points of one solid in one type, and labels them as they are rounded."""

    def __init__(self, store, name, seed):
        vertices, faces = store.mesh(name)
        centre, scale = store.frame(name)
        self.body = Body(vertices, faces.astype(np.int64), Frame(tuple(centre), scale))
        self.rng = generator(stage_seed(seed, name, "layout"))

    def volume(self, count):
        """Points in the cube [-1, 1]³."""
        return self.rng.uniform(-1, 1, (count, 3))

    def surface(self, count):
        """Points and normals on the surface, in random order (count, 6)."""
        points, normals, _, _ = self.body.surface.draw(count, self.rng)
        return np.concatenate([points, normals], axis=1)[self.rng.permutation(count)]

    def sharp(self, count):
        """Points on sharp edges with the normal of either face (count, 6).

        Without sharp edges, they are points on the surface.
        """
        surface = self.body.surface
        table = edges_of(surface.faces)
        pairs = table.pairs()
        sides = pairs // 3
        cosine = np.einsum("ij,ij->i", *np.moveaxis(surface.normals[sides], 1, 0))
        sharp = cosine < np.cos(np.radians(_SHARP))
        if not sharp.any():
            return self.surface(count)
        edges, sides = table.directed[pairs[sharp, 0]], sides[sharp]
        start, end = surface.vertices[edges[:, 0]], surface.vertices[edges[:, 1]]
        share = np.cumsum(np.linalg.norm(end - start, axis=1))
        place = (np.arange(count) + self.rng.random(count)) / count
        edge = np.minimum(np.searchsorted(share / share[-1], place, side="right"), len(edges) - 1)
        along = self.rng.random(count)[:, None]
        points = start[edge] + along * (end[edge] - start[edge])
        side = sides[edge, self.rng.integers(2, size=count)]
        rows = np.concatenate([points, surface.normals[side]], axis=1)
        return rows[self.rng.permutation(count)]

    def near(self, points, scales):
        """Points moved by normal noise of each scale in turn."""
        scale = np.array(scales)[np.arange(len(points)) % len(scales)]
        return points[:, :3] + scale[:, None] * self.rng.normal(size=(len(points), 3))

    def labelled(self, points, kind):
        """Return points rounded to a type, and their exact distances in it, positive outside."""
        rounded = points.astype(kind)
        labels = self.body.distance.label(rounded.astype(np.float64), ties=False)
        return rounded, labels.distance.astype(kind)


def _vecset(drawer, count):
    """3DShape2VecSet: occupancies; its scale file is 1, since points are in the unit frame."""
    parts, kind = {}, np.float32
    surface = drawer.surface(max(count.surface, count.near))
    for name, points in (("vol", drawer.volume(count.volume)),
                         ("near", drawer.near(surface[: count.near], _NEAR))):  # fmt: skip
        rounded, distance = drawer.labelled(points, kind)
        parts |= {f"{name}_points": rounded, f"{name}_label": (distance < 0).astype(np.float32)}
    cloud = surface[: count.surface].astype(kind)
    points = parts | {"sign": np.array(_OCCUPANCY)}
    return {
        "ShapeNetV2_point/{category}/{id}.npz": points,
        "ShapeNetV2_point/{category}/{id}.npy": np.array(1.0),
        "ShapeNetV2_watertight/{category}/4_pointcloud/{id}.npz": {
            "points": cloud[:, :3], "normals": cloud[:, 3:]
        },
    }  # fmt: skip


def _hunyuan(drawer, count):
    """Hunyuan3D-2.1: half precision; distances are positive outside, as its description says."""
    kind, surface, sharp = np.float16, drawer.surface(count.surface), drawer.sharp(count.sharp)
    base = drawer.surface(count.near)
    arrays = {"sign": np.array(_POSITIVE)}
    for name, points in (("vol", drawer.volume(count.volume)),
                         ("random_near", drawer.near(base, _NEAR)),
                         ("sharp_near", drawer.near(sharp, _NEAR_EDGES))):  # fmt: skip
        arrays[f"{name}_points"], arrays[f"{name}_label"] = drawer.labelled(points, kind)
    both = {"random_surface": surface.astype(kind), "sharp_surface": sharp.astype(kind)}
    return {"{category}/{id}_surface.npz": both, "{category}/{id}_sdf.npz": arrays}


def _dora(drawer, count):
    """Dora and CraftsMan3D's Dora-VAE: surfaces (n, 1, 6), points with distances (n, 4)."""
    kind, surface, sharp = np.float32, drawer.surface(count.surface), drawer.sharp(count.sharp)
    spread = np.concatenate([
        drawer.near(drawer.surface(count.near), _NEAR), drawer.volume(count.volume)
    ])  # fmt: skip
    arrays = {
        "fps_coarse_surface": surface.astype(kind)[:, None],
        "fps_sharp_surface": sharp.astype(kind)[:, None],
        "sign": np.array(_POSITIVE),
    }
    for name, points in (("sharp_near_surface", drawer.near(sharp, _NEAR_EDGES)),
                         ("rand_points", spread)):  # fmt: skip
        rounded, distance = drawer.labelled(points, kind)
        arrays[name] = np.concatenate([rounded, distance[:, None]], axis=1)
    return {"{category}/{id}.npz": arrays}


#: Layouts whose points are drawn anew, and those that write the stored rows.
_DRAWN = {"vecset": _vecset, "hunyuan": _hunyuan, "dora": _dora}
LAYOUTS = (*_DRAWN, "npz", "webdataset", "zarr", "pandis")


def write_layout(store, layout, folder, *, points=None, seed=0, log=lambda text: None):
    """Write all meshes of a store in a layout.

    Parameters
    ----------
    store : pandis.pipeline.dataset.store.LabelStore
        With all its columns, for the layouts that have its rows.
    layout : {"vecset", "hunyuan", "dora", "npz", "webdataset", "zarr", "pandis"}
    folder : path-like
    points : Points, optional
        Numbers of points of the first three layouts; the next three have the rows of the store,
        and the last one its fields.
    seed : int
    log : pandis.base.progress.Log

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    PandisError
        The layout is unknown, or a file cannot be written.
    """
    if layout not in LAYOUTS:
        raise PandisError(f"there is no layout {layout}; there are {', '.join(LAYOUTS)}")
    folder, written = Path(folder), []
    if (points and min(points) < 1) or seed < 0:
        raise PandisError("numbers of points must be at least 1, and the seed at least 0")
    if layout == "zarr":
        return write_joined(store, folder, log)
    _refuse_equal_places(store.names, layout)
    if layout == "webdataset":
        return _tars(store, folder, log)
    categories = {}
    for name in store.names:
        place = _place(name)
        categories.setdefault(place["category"], []).append(place["id"])
        if layout == "npz":
            files = {"{category}/{id}.npz": _rows(store, name)}
        elif layout == "pandis":
            files = _fields(store, name)
        else:
            files = _DRAWN[layout](_Drawer(store, name, seed), points or Points())
        for pattern, content in files.items():
            path = folder / pattern.format(**place)
            write_atomically(path, _bytes(content))
            written.append(path)
        log(f"{len(written)} files, {name}")
    if layout == "vecset":
        for category, stems in categories.items():
            path = folder / f"ShapeNetV2_point/{category}/train.lst"
            write_atomically(path, "\n".join(stems).encode())
            written.append(path)
    return written


def _place(name):
    """Return the category and the identifier of a mesh; folders of a name are its category."""
    category, _, stem = name.rpartition("/")
    return {"category": category.replace("/", "-") or "all", "id": stem}


def _tar_key(name):
    """Return the key of a mesh in a tar, which ends at the first dot."""
    return name.replace("/", "-").replace(".", "_")


def _refuse_equal_places(names, layout):
    """Refuse names that a layout cannot tell apart."""
    places = {}
    for name in names:
        key = _tar_key(name) if layout == "webdataset" else "/".join(_place(name).values())
        if key in places:
            raise PandisError(
                f"{places[key]} and {name} would both be written to {key}: rename one, or list "
                "the meshes in a table (.csv) with names"
            )
        places[key] = name


def _rows(store, name):
    centre, scale = store.frame(name)
    about = {"centre": centre, "scale": np.array(scale), "sign": np.array("negative inside"),
             "strata": np.array(store.strata)}  # fmt: skip
    return store.rows(name) | about


def _fields(store, name):
    """Return the files of a mesh's fields."""
    facts = store.facts[name]
    if not facts.files and not facts.unbuilt:
        raise PandisError(
            f"{store.path}: there are no fields of {name}; add them to `fields` of the data set"
        )
    return {f"{{category}}/{{id}}.{kind}.pandis": store.file(name, kind) for kind in facts.files}


def _bytes(content):
    if isinstance(content, bytes):
        return content
    stream = io.BytesIO()
    if isinstance(content, dict):
        np.savez(stream, **content)
    else:
        np.save(stream, content)
    return stream.getvalue()


def _tars(store, folder, log):
    """Write a tar for each shard: two files for each mesh, its rows and its facts."""
    shards = {}
    for name in store.names:
        shards.setdefault(store.facts[name].shard[0], []).append(name)
    written = []
    for number, names in sorted(shards.items()):
        stream = io.BytesIO()
        with tarfile.open(fileobj=stream, mode="w") as archive:
            for name in names:
                facts = store.facts[name].model_dump_json().encode()
                for ending, data in (("npz", _bytes(_rows(store, name))), ("json", facts)):
                    info = tarfile.TarInfo(f"{_tar_key(name)}.{ending}")
                    info.size = len(data)
                    archive.addfile(info, io.BytesIO(data))
        path = folder / f"{number:05}.tar"
        write_atomically(path, stream.getvalue())
        written.append(path)
        log(f"{path.name}: {len(names)} meshes")
    return written

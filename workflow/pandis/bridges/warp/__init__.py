"""Fields in Warp: functions that kernels call, on the CPU and on CUDA devices.

They are meant for simulations that run in Warp, such as MuJoCo Warp
(`pandis.bridges.warp.mujoco`) and Newton.
"""

from functools import cache
from os import PathLike
from typing import Any

from pandis.base.errors import PandisError
from pandis.runtime.field.constants import COMPACT, NETWORK, SPLINE
from pandis.runtime.field.files import read_contents

try:
    import warp as wp
except ImportError as error:
    raise PandisError('Warp is not installed: pip install "warp-lang>=1.19"') from error

from pandis.bridges.warp.compact import compact_answer
from pandis.bridges.warp.data import ROOM, Answer, Field, upload
from pandis.bridges.warp.networks import network_answer
from pandis.bridges.warp.splines import INVALID, spline_answer

#: Limit of coordinates: beyond it squares overflow, so there is no answer, as in pandis.h.
_FARTHEST = wp.constant(wp.float64(1e150))


class WarpField:
    """A spline, a compact mesh or a network, for queries in Warp.

    Parameters
    ----------
    path : path-like
        A ``.pandis`` file of one of these kinds.
    device : optional
        Warp device; Warp's default device if None.

    Raises
    ------
    PandisError
        The field is of another kind, or is a compact mesh whose tree is too deep.
    ArtifactError
        The file cannot be read, or is damaged.

    Attributes
    ----------
    data : Field
        The field's data for kernels: the first argument of `answer`.
    answer : wp.Function
        ``answer(data, point) -> Answer``: distance, unit normal and flag at a ``vec3d``; all in
        mesh units and in double precision. No query of a compact mesh is cut short, so the distance
        is right everywhere. By contrast, pandis.h stops a query after the number of steps that its
        file allows.

    Examples
    --------
    >>> field = WarpField("results/bunny/export/spline-auto.pandis")
    >>> answer = field.answer
    >>> @wp.kernel
    ... def push(data: Field, points: wp.array(dtype=wp.vec3d), out: wp.array(dtype=wp.vec3d)):
    ...     i = wp.tid()
    ...     a = answer(data, points[i])
    ...     depth = wp.min(a.distance, wp.float64(0.0))
    ...     out[i] = wp.float64(-400.0) * depth * a.normal
    """

    def __init__(self, path: str | PathLike[str], device: Any = None) -> None:
        contents = read_contents(path)
        self.path, self.kind, self.frame = (
            contents.field.path,
            contents.field.kind,
            contents.field.frame,
        )
        if self.kind not in (SPLINE, COMPACT, NETWORK):
            raise PandisError(
                f"{self.path}: Warp supports splines, compact meshes and networks only"
            )
        if self.kind == COMPACT and (needed := _room(contents)) > ROOM:
            raise PandisError(
                f"{self.path}: its tree is too deep: a query needs room for {needed} boxes, and "
                f"there is room for {ROOM}; export the mesh again, or use a spline of it"
            )
        self.device = wp.get_device(device)
        self.data = upload(contents, self.device)
        self.answer = function(self.kind, self.data.width, self.data.outputs)

    def query(self, points: Any) -> tuple[Any, Any, Any]:
        """Query points, as `pandis.runtime.field.NativeField.query` does.

        Parameters
        ----------
        points : wp.array of vec3d, or array-like, shape (n, 3)
            Mesh units.

        Returns
        -------
        distances, normals, flags : wp.array of float64, of vec3d, of int32
            On the field's device; ``.numpy()`` copies them to the host.
        """
        if not isinstance(points, wp.array):
            points = wp.array(points, dtype=wp.vec3d, device=self.device)
        count = len(points)
        kinds = wp.float64, wp.vec3d, wp.int32
        out = tuple(wp.empty(count, dtype=kind, device=self.device) for kind in kinds)
        kernel = _kernel(self.kind, self.data.width, self.data.outputs)
        wp.launch(kernel, count, [self.data, points], list(out), device=self.device)
        return out


@cache
def function(kind, width, outputs):
    """Return the function that maps (Field, vec3d) to Answer for a kind of field."""
    if kind == NETWORK:
        inner = network_answer(width, outputs)
    else:
        inner = {SPLINE: spline_answer, COMPACT: compact_answer}[kind]

    @wp.func
    def answer(field: Field, point: wp.vec3d) -> Answer:
        u = (point - field.centre) * field.scale
        for k in range(3):
            if not (wp.abs(u[k]) < _FARTHEST):
                none = Answer()
                none.distance = wp.float64(wp.nan)
                none.flag = INVALID
                none.normal = wp.vec3d(none.distance, none.distance, none.distance)
                return none
        return inner(field, point)

    return answer


@cache
def _kernel(kind, width, outputs):
    answer = function(kind, width, outputs)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def ask(
        field: Field,
        points: wp.array(dtype=wp.vec3d),
        distances: wp.array(dtype=wp.float64),
        normals: wp.array(dtype=wp.vec3d),
        flags: wp.array(dtype=wp.int32),
    ):
        i = wp.tid()
        one = answer(field, points[i])
        distances[i] = one.distance
        normals[i] = one.normal
        flags[i] = one.flag

    return ask


def _room(contents):
    """Return the maximum number of pending boxes, from the depth of a compact mesh's tree."""
    import numpy as np

    branches = np.frombuffer(contents.sections["BRCH"], "<i4").reshape(-1, 24)
    depths = np.zeros(len(branches), int)
    counts = branches[:, 3].view(np.uint32) >> 24
    for number, (children, count) in enumerate(zip(branches[:, 16:], counts, strict=True)):
        for child in children[:count]:
            if child >= 0:  # parents come before their children
                depths[child] = depths[number] + 1
    return 7 * (int(depths.max()) + 1) + 1

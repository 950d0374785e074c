"""Models with pandis fields in MuJoCo Warp: the counterpart of `pandis.sdf` in MuJoCo."""

import copy
from collections.abc import Iterable
from typing import Any

import numpy as np
import warp as wp

from pandis.base.errors import PandisError
from pandis.bridges.warp import WarpField
from pandis.bridges.warp.data import Field

try:
    import mujoco_warp
    from mujoco_warp._src import collision_sdf
    from mujoco_warp._src.types import vec_pluginattr
except ImportError as error:
    raise PandisError('MuJoCo Warp is not installed: pip install "mujoco-warp==4.0.0"') from error

#: An instance's first number, which identifies its function, is this plus 1, 2, ….
_MARK = 76_911
#: Offsets of the other numbers: the field's address in parts of 22 bits, scale, origin, rotation.
_ADDRESS, _SCALE, _ORIGIN, _TURN = 1, 4, 5, 8
#: Distance at points without an answer, as in MuJoCo.
_NOWHERE = wp.constant(1e10)

#: Functions installed for collisions so far. Item i serves the instances whose first number is
#: _MARK + 1 + i.
_known: list = []


@wp.func
def _field_at(attributes: vec_pluginattr) -> Field:
    """Return the field at the address stored in an instance's numbers."""
    address = wp.uint64(0)
    for i in range(3):
        part = wp.uint64(attributes[_ADDRESS_OF + i])
        address = address | (part << wp.uint64(22 * i))
    fields = wp.array(ptr=address, shape=(1,), dtype=Field)
    return fields[0]


@wp.func
def _into_file(p: wp.vec3, attributes: vec_pluginattr) -> wp.vec3d:
    """Transform a point of a geom into the frame and units of its file."""
    point, scale = wp.vec3d(), wp.float64(attributes[_SCALE_OF])
    for k in range(3):
        at = wp.float64(attributes[_ORIGIN_OF + k])
        for i in range(3):
            at += wp.float64(attributes[_TURN_OF + 3 * k + i]) * wp.float64(p[i])
        point[k] = at / scale
    return point


@wp.func
def _into_geom(n: wp.vec3d, attributes: vec_pluginattr) -> wp.vec3:
    """Rotate a normal of the file into a geom's frame."""
    turned = wp.vec3()
    for k in range(3):
        for i in range(3):
            turned[k] += attributes[_TURN_OF + 3 * i + k] * float(n[i])
    return turned


_ADDRESS_OF, _SCALE_OF = wp.constant(_ADDRESS), wp.constant(_SCALE)
_ORIGIN_OF, _TURN_OF = wp.constant(_ORIGIN), wp.constant(_TURN)


def put_model(model: Any, instances: Iterable[Any], **options: Any) -> "mujoco_warp.Model":
    """Copy a model with geoms of `pandis.sdf` to the device, like ``mujoco_warp.put_model``.

    Their fields must be splines, compact meshes or networks. Geoms of other plugins still use the
    functions installed for them.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled with the plugin.
    instances : iterable of pandis.bridges.mujoco.instances.Instance
        The model's geoms of `pandis.sdf`: ``instances(model)``.
    **options
        Passed on to ``mujoco_warp.put_model``.

    Returns
    -------
    mujoco_warp.Model
        The model on the device; it keeps the fields of its geoms alive.

    Raises
    ------
    PandisError
        A field is of another kind.
    ArtifactError
        A file cannot be read, or is damaged.
    """
    by_geom = {each.geom: each for each in instances}
    files = {each.file: WarpField(each.file) for each in by_geom.values()}
    fields = {geom: files[each.file] for geom, each in by_geom.items()}
    for field in fields.values():
        _install(field.answer)
    put = mujoco_warp.put_model(
        _without_texts(model, {each.number for each in by_geom.values()}), **options
    )
    geoms = np.nonzero(model.geom_plugin >= 0)[0].tolist()
    rows, arrays = put.plugin_attr.numpy().copy(), []
    for row, geom in zip(rows, geoms, strict=True):
        if geom in fields:
            field = fields[geom]
            data = wp.array([field.data], dtype=Field, device=put.plugin_attr.device)
            arrays += [field, data]
            row[:] = _numbers(by_geom[geom], field.answer, data.ptr)
    put.plugin_attr = wp.array(rows, dtype=vec_pluginattr, device=put.plugin_attr.device)
    put.pandis_fields = arrays  # keep their memory alive as long as the model
    return put


def _numbers(instance, answer, address):
    """Return the numbers that an instance's functions read: a row of MuJoCo Warp's attributes."""
    row = np.zeros(vec_pluginattr._length_, np.float32)
    row[0] = _MARK + 1 + _known.index(answer)
    row[_ADDRESS : _ADDRESS + 3] = [(address >> 22 * i) & 0x3FFFFF for i in range(3)]
    row[_SCALE] = instance.scale
    row[_ORIGIN : _ORIGIN + 3], row[_TURN : _TURN + 9] = instance.origin, instance.turn.ravel()
    return row


def _without_texts(model, numbers):
    """Return a copy of a model without file names, because MuJoCo Warp cannot read strings."""
    other = copy.copy(model)
    for number in numbers:
        ends = [*other.plugin_attradr[number + 1 :], len(other.plugin_attr)]
        other.plugin_attr[other.plugin_attradr[number] : ends[0]] = 0
    return other


def _install(answer):
    """Make collisions call a function ahead of those installed earlier."""
    if answer in _known:
        return
    mark = wp.constant(float(_MARK + 1 + len(_known)))
    distance_before, normal_before = collision_sdf.user_sdf, collision_sdf.user_sdf_grad

    @wp.func
    def user_sdf(p: wp.vec3, attributes: vec_pluginattr, plugin: int) -> float:
        if attributes[0] != mark:
            return distance_before(p, attributes, plugin)
        one = answer(_field_at(attributes), _into_file(p, attributes))
        if one.flag == 2:
            return _NOWHERE
        return float(one.distance * wp.float64(attributes[_SCALE_OF]))

    @wp.func
    def user_sdf_grad(p: wp.vec3, attributes: vec_pluginattr, plugin: int) -> wp.vec3:
        if attributes[0] != mark:
            return normal_before(p, attributes, plugin)
        one = answer(_field_at(attributes), _into_file(p, attributes))
        if one.flag == 2:
            return wp.vec3()
        return _into_geom(one.normal, attributes)

    collision_sdf.user_sdf, collision_sdf.user_sdf_grad = user_sdf, user_sdf_grad
    wp.get_module(collision_sdf.__name__).mark_modified()  # it may already be compiled without them
    _known.append(answer)

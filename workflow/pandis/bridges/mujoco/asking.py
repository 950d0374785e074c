"""Queries MuJoCo for a geom's signed distances, as its collision code does."""

import ctypes

import numpy as np

from pandis.bridges.mujoco import package


class Sdf(ctypes.Structure):
    """MuJoCo's structure mjSDF."""

    _fields_ = (
        ("plugin", ctypes.POINTER(ctypes.c_void_p)), ("id", ctypes.POINTER(ctypes.c_int)),
        ("type", ctypes.c_int), ("position", ctypes.c_void_p), ("matrix", ctypes.c_void_p),
        ("geom", ctypes.c_void_p),
    )  # fmt: skip


def asker(model, geom=0):
    """Return a function that computes distances (n,) and gradients (n, 3) of a model's geom.

    The function takes points (n, 3) in the geom's frame. For a geom without a plugin it uses
    MuJoCo's own field of the mesh.
    """
    import mujoco

    core = ctypes.CDLL(str(next(package().glob("libmujoco*"))))
    core.mjc_getSDF.restype, core.mjc_distance.restype = ctypes.c_void_p, ctypes.c_double
    data, plugin = mujoco.MjData(model), ctypes.c_void_p()
    number = max(int(model.geom_plugin[geom]), 0)
    if model.nplugin:
        plugin = ctypes.c_void_p(core.mjc_getSDF(ctypes.c_void_p(model._address), geom))
    pose, kind = np.append(np.zeros(3), np.eye(3)), ctypes.c_int(mujoco.mjtGeom.mjGEOM_SDF)
    sdf = Sdf(
        ctypes.pointer(plugin),
        ctypes.pointer(ctypes.c_int(number)),
        0,
        pose.ctypes.data,
        pose[3:].ctypes.data,
        ctypes.addressof(kind),
    )
    sdf.alive = plugin, pose, kind  # keep alive while MuJoCo holds pointers to them

    def answers(points):
        arguments = [ctypes.c_void_p(one._address) for one in (model, data)] + [ctypes.byref(sdf)]
        distances, gradients = np.empty(len(points)), np.empty((len(points), 3))
        for i, (point, gradient) in enumerate(
            zip(np.ascontiguousarray(points), gradients, strict=True)
        ):
            place, into = (ctypes.c_void_p(array.ctypes.data) for array in (point, gradient))
            if i % 3:  # sometimes query the gradient first, as MuJoCo may
                core.mjc_gradient(*arguments, into, place)
            distances[i] = core.mjc_distance(*arguments, place)
            core.mjc_gradient(*arguments, into, place)
        return distances, gradients

    return answers

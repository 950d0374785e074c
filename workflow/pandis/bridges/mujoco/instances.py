"""Instances of the plugin in a compiled model: their files, scales and poses."""

import ctypes
from functools import cache
from typing import NamedTuple

import numpy as np

from pandis.bridges.mujoco import NAME, package


class Instance(NamedTuple):
    """A geom whose distances come from a file.

    Attributes
    ----------
    geom, number : int
        Indices of the geom, and of the plugin's instance, in the model.
    file : str
    scale : float
        Model length of one file unit.
    origin, turn : ndarray, shape (3,) and (3, 3)
        A point x in the geom's frame is at (origin + turn @ x) / scale in the file. The frames
        differ because MuJoCo moves the origin of a mesh read from a file to its centre of mass.
    """

    geom: int
    number: int
    file: str
    scale: float
    origin: np.ndarray
    turn: np.ndarray

    def placed(self, data):
        """Return rotation (3, 3) and translation (3,) of the object in the world.

        A point p of the file is at ``scale * rotation @ p + translation``.
        """
        rotation = data.geom_xmat[self.geom].reshape(3, 3) @ self.turn.T
        return rotation, data.geom_xpos[self.geom] - rotation @ self.origin


def instances(model):
    """Return the `Instance` of every geom in a model that uses the plugin `pandis.sdf`."""
    import mujoco

    result = []
    for geom, number in enumerate(model.geom_plugin.tolist()):
        # the first member of a plugin is its name
        if number < 0 or _core().mjp_getPluginAtSlot(int(model.plugin[number]))[0] != NAME.encode():
            continue
        mesh, origin, turn = model.geom_dataid[geom], np.zeros(3), np.eye(3).ravel()
        if mesh >= 0:
            origin = np.array(model.mesh_pos[mesh])
            mujoco.mju_quat2Mat(turn, model.mesh_quat[mesh])
        scale = float(_config(model, number, "scale") or 1)
        result.append(Instance(geom, number, _config(model, number, "file"), scale, origin,
                             turn.reshape(3, 3)))  # fmt: skip
    return result


@cache
def _core():
    """Return MuJoCo's library, which is already loaded."""
    core = ctypes.CDLL(str(sorted(package().glob("libmujoco*"))[0]))
    core.mjp_getPluginAtSlot.restype = ctypes.POINTER(ctypes.c_char_p)
    core.mj_getPluginConfig.restype = ctypes.c_char_p
    core.mj_getPluginConfig.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p]
    return core


def _config(model, number, name):
    return _core().mj_getPluginConfig(model._address, number, name.encode()).decode()

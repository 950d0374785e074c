"""Fields as signed distance fields of MuJoCo: the plugin ``pandis.sdf``, and scenes as MJCF.

MuJoCo finds the plugin of an installed package when it is imported. From a checkout, `register` it.
"""

import ctypes
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from pandis.base.errors import PandisError
from pandis.engine.compiler import compiled

SOURCE = Path(__file__).with_name("plugin.c")
#: The plugin's name in MJCF.
NAME = "pandis.sdf"
#: Releases of MuJoCo whose memory layout the plugin was made for: it changes from one to another.
VERSIONS = ("4.0.0", "4.0.1")
#: What the plugin is handed of MuJoCo, in its order.
_FUNCTIONS = ("mj_version", "mjp_defaultPlugin", "mjp_registerPlugin", "mj_getPluginConfig",
              "mju_warning")  # fmt: skip


def library() -> Path:
    """Return the path of the plugin, for programs in C: what ``mj_loadPluginLibrary`` takes.

    Raises
    ------
    PandisError
        It has to be compiled first, and there is no MuJoCo to compile it for, or no compiler.
    """
    return compiled(SOURCE, (package() / "include",))


@cache
def register() -> None:
    """Register the plugin with MuJoCo.

    Raises
    ------
    PandisError
        There is no MuJoCo, or one of another version, or in single precision.
    """
    folder = package()
    import mujoco

    version = mujoco.mj_versionString() + ("" if mujoco.MJTNUM_BYTES == 8 else " in float32")
    if version not in VERSIONS:
        raise PandisError(
            f"{NAME} supports only MuJoCo {' and '.join(VERSIONS)} in float64, not {version}: it "
            "is not registered, so models that use it will not compile"
        )
    libraries = sorted(folder.glob("libmujoco*"))
    if not libraries:
        raise PandisError(f"{folder}: there is no libmujoco here: install mujoco-core again")
    core = ctypes.CDLL(str(libraries[0]))  # the one that is loaded
    functions = [ctypes.cast(getattr(core, name), ctypes.c_void_p) for name in _FUNCTIONS]
    plugin = ctypes.CDLL(str(library()))
    if not plugin.pandis_mujoco_register((ctypes.c_void_p * len(functions))(*functions)):
        raise PandisError(f"{NAME}: {libraries[0]} is of another version than {version}")


def package():
    """Return the folder of the package ``mujoco``, without importing it.

    Raises
    ------
    PandisError
        There is none.
    """
    spec = find_spec("mujoco")
    if spec is None:
        raise PandisError('there is no MuJoCo here: pip install "mujoco==4.0.1"')
    return Path(spec.submodule_search_locations[0])

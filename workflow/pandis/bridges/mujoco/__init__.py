"""Fields as MuJoCo signed distance fields (the plugin ``pandis.sdf``), and scenes as MJCF.

MuJoCo finds the plugin of an installed package on import. In a checkout, call `register`.
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
#: Supported releases of MuJoCo: memory layouts change between releases.
VERSIONS = ("4.0.0", "4.0.1")
#: Functions of MuJoCo that are passed to the plugin, in the order of its structure's members.
_FUNCTIONS = ("mj_version", "mjp_defaultPlugin", "mjp_registerPlugin", "mj_getPluginConfig",
              "mju_warning")  # fmt: skip


def library() -> Path:
    """Return the path of the plugin, for C programs that call ``mj_loadPluginLibrary``.

    Raises
    ------
    PandisError
        The plugin must be compiled first, but MuJoCo or a compiler is missing.
    """
    return compiled(SOURCE, (package() / "include",))


@cache
def register() -> None:
    """Register the plugin with MuJoCo.

    Raises
    ------
    PandisError
        MuJoCo is missing, has an unsupported version, or uses single precision.
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
        raise PandisError(f"{folder}: libmujoco is missing: reinstall mujoco-core")
    core = ctypes.CDLL(str(libraries[0]))  # already loaded by the import
    functions = [ctypes.cast(getattr(core, name), ctypes.c_void_p) for name in _FUNCTIONS]
    plugin = ctypes.CDLL(str(library()))
    if not plugin.pandis_mujoco_register((ctypes.c_void_p * len(functions))(*functions)):
        raise PandisError(f"{NAME}: the version of {libraries[0]} is not {version}")


def package():
    """Return the folder of the package ``mujoco``, without importing it.

    Raises
    ------
    PandisError
        MuJoCo is not installed.
    """
    spec = find_spec("mujoco")
    if spec is None:
        raise PandisError('MuJoCo is not installed: pip install "mujoco==4.0.1"')
    return Path(spec.submodule_search_locations[0])

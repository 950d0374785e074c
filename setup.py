"""Builds the package: with its C code compiled for machines of this kind."""

import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

sys.path.insert(0, str(Path(__file__).parent / "workflow"))

from pandis.base.errors import PandisError
from pandis.engine.compiler import prebuild

#: The oldest C library that a wheel for all Linux systems may ask for: 2.17.
OLDEST = 17


def foreign():
    """Return the headers of other projects by library; says which plugin the package lacks."""
    found = find_spec("mujoco")
    if found is None:
        print("no mujoco here (pip install mujoco-core): its plugin compiles on first use")
        return {}
    return {"pandis-mujoco": Path(found.submodule_search_locations[0]) / "include"}


class BuildPy(build_py):
    """Modules, and what of C they load."""

    made = ()

    def run(self):
        """Copy the modules; compile beside them, unless they stay where they are."""
        super().run()
        if self.editable_mode:
            return
        folder = Path(self.build_lib) / "pandis/engine/built"
        shutil.rmtree(folder, ignore_errors=True)  # an earlier build's are of other sources
        try:
            BuildPy.made = prebuild(folder, foreign())
        except PandisError as error:
            self.warn(f"{error}; the package will compile on first use")


class Wheel(bdist_wheel):
    """A wheel for every Python, and for the machine that its libraries are for."""

    def get_tag(self):
        """Return the tag: any Python 3; all Linux systems, if the libraries ask for no more."""
        *_, platform = super().get_tag()
        if not BuildPy.made:
            return "py3", "none", "any"
        asked = [int(minor) for path in BuildPy.made
                 for minor in re.findall(rb"GLIBC_2\.(\d+)", path.read_bytes())]  # fmt: skip
        if platform.startswith("linux_") and max(asked, default=0) <= OLDEST:
            machine = platform.removeprefix("linux_")
            platform = f"manylinux_2_{OLDEST}_{machine}.manylinux2014_{machine}"
        return "py3", "none", platform


class Compiled(Distribution):
    """What belongs to one kind of machine."""

    def has_ext_modules(self):
        """Libraries are no extension modules, and yet of a platform."""
        return True


setup(distclass=Compiled, cmdclass={"build_py": BuildPy, "bdist_wheel": Wheel})

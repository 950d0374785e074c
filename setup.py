"""Builds the package, with its C code compiled for this platform."""

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

#: Minor version of glibc 2.17, the newest that a manylinux2014 wheel may need.
OLDEST = 17


def foreign():
    """Return other projects' header folders by library; report a plugin that is left out."""
    found = find_spec("mujoco")
    if found is None:
        print("no mujoco here (pip install mujoco-core): its plugin is compiled on first use")
        return {}
    return {"pandis-mujoco": Path(found.submodule_search_locations[0]) / "include"}


class BuildPy(build_py):
    """Builds the modules and the C libraries that they load."""

    made = ()

    def run(self):
        """Copy the modules; compile libraries beside them, unless the install is editable."""
        super().run()
        if self.editable_mode:
            return
        self._copy_workflow()
        folder = Path(self.build_lib) / "pandis/engine/built"
        shutil.rmtree(folder, ignore_errors=True)  # an earlier build had other sources
        try:
            BuildPy.made = prebuild(folder, foreign())
        except PandisError as error:
            self.warn(f"{error}; the package will compile its C code on first use")

    def _copy_workflow(self):
        """Copy the Snakefile and everything that it needs, in the layout of a checkout."""
        here, there = Path(__file__).parent, Path(self.build_lib) / "pandis/snakemake"
        shutil.rmtree(there, ignore_errors=True)
        ignore = shutil.ignore_patterns("__pycache__", "pandis", "*.egg-info")
        for name in ("workflow", "rules", "scripts", "config"):
            shutil.copytree(here / name, there / name, ignore=ignore)


class Wheel(bdist_wheel):
    """A wheel for every Python 3, on the platform of its libraries."""

    def get_tag(self):
        """Return the tag: any Python 3, and manylinux if the libraries need no newer glibc."""
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
    """A distribution for one platform."""

    def has_ext_modules(self):
        """Return True: the libraries are not extension modules, but depend on the platform."""
        return True


setup(distclass=Compiled, cmdclass={"build_py": BuildPy, "bdist_wheel": Wheel})

"""Queries networks as the paper does: from a C++ program on LibTorch, one query at a time.

`query.cpp` is built against the headers and libraries of the installed torch package. AOTInductor
compiles the exported program (``.pt2``) for it. The compiled package is not stored as an artifact:
it works only with one version of torch on one processor.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from pandis.base.errors import PandisError
from pandis.engine.compiler import build

_COMPILE = """
import sys, torch
program = torch.export.load(sys.argv[1])
torch._inductor.aoti_compile_and_package(program, package_path=sys.argv[2])
"""


def ask(path, points, queries):
    """Query a network from C++, on one thread.

    Parameters
    ----------
    path : path-like
        A ``.pt2`` file of `pandis.pipeline.kinds.network.program`.
    points : ndarray, shape (n, 3), mesh units
    queries : int

    Returns
    -------
    distance : ndarray, shape (n,)
    normal : ndarray, shape (n, 3)
    seconds : ndarray, shape (queries,)
        Times of single queries, which cycle through the points in order. As a warm-up, all points
        are queried once beforehand.

    Raises
    ------
    PandisError
        There is no C++ compiler, or a program does not build or run.
    """
    program = _program()
    with tempfile.TemporaryDirectory(prefix="pandis-") as folder:
        package, inputs, answered = (Path(folder) / n for n in ("a.pt2", "points", "answers"))
        # for one small network, extra compile threads and precompiled headers do not pay off
        quick = {
            "TORCHINDUCTOR_CACHE_DIR": folder,
            "TORCHINDUCTOR_COMPILE_THREADS": "1",
            "TORCHINDUCTOR_CPP_CACHE_PRECOMPILE_HEADERS": "0",
            "OMP_NUM_THREADS": "1",
        }
        _run([sys.executable, "-c", _COMPILE, str(path), str(package)], quick)
        np.ascontiguousarray(points, np.float64).tofile(inputs)
        _run([str(program), str(package), str(inputs), str(answered), str(queries)], quick)
        numbers = np.fromfile(answered)
    answers = numbers[: 4 * len(points)].reshape(-1, 4)
    return answers[:, 0], answers[:, 1:], numbers[4 * len(points) :] * 1e-9


def _program():
    """Build `query.cpp` unless it is already built; return the program's path."""
    import torch
    from torch.utils import cpp_extension

    compiler = os.environ.get("CXX") or next(filter(shutil.which, ("c++", "g++", "clang++")), None)
    if compiler is None or not shutil.which(compiler):
        raise PandisError(
            "timing.libtorch: no C++ compiler found: install one (Debian: apt-get install g++), "
            "name it in the environment variable CXX, or set timing.libtorch to false"
        )
    folder = Path(torch.__file__).parent / "lib"
    command = [compiler, "-O2", "-std=c++20"]
    command += [f"-I{include}" for include in cpp_extension.include_paths()]
    libraries = [f"-L{folder}", f"-Wl,-rpath,{folder}", "-ltorch", "-ltorch_cpu", "-lc10"]
    command.append(f'-DPANDIS_TORCH="{torch.__version__}"')  # one program per version
    return build(command, Path(__file__).with_name("query.cpp"), libraries, name="libtorch-query")


def _run(command, extra):
    done = subprocess.run(
        command, env=os.environ | extra, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise PandisError(
            f"timing.libtorch: {Path(command[0]).name} failed:\n{done.stderr[-2000:]}"
        )

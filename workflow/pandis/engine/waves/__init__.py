"""Sines and cosines of a network layer on the CPU: the binding of ``waves.c``."""

import ctypes
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from pathlib import Path

from pandis.engine.compiler import load


@cache
def library():
    """Return the compiled library with its functions' types declared."""
    lib = load(Path(__file__).with_name("waves.c"))
    pointer, i64 = ctypes.c_void_p, ctypes.c_int64
    lib.waves_sines.argtypes = [pointer, pointer, pointer, i64, i64, i64]
    return lib


@cache
def _pool(threads):
    """Return a reusable pool of threads, because starting threads takes as long as the work."""
    return ThreadPoolExecutor(threads)


def sines(z, bias, cosine, *, shape, threads):
    """Replace z by sin(z + bias) and store cos(z + bias), within 1.2e-7 for |z + bias| <= 1e4.

    Parameters
    ----------
    z, cosine : int
        Addresses of float32 numbers, in row-major order.
    bias : int
        Address of one float32 per row.
    shape : tuple of int
        Numbers of rows and columns.
    threads : int
        Does not change the result.
    """
    rows, columns = shape
    work = library().waves_sines
    if threads == 1:
        work(z, bias, cosine, 0, rows, columns)
        return
    edges = pairwise([rows * k // threads for k in range(threads + 1)])
    parts = [_pool(threads).submit(work, z, bias, cosine, *edge, columns) for edge in edges]
    for part in parts:
        part.result()

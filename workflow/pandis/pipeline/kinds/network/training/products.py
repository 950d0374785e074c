"""Computes matrix products, on the CPU through oneDNN where torch has it, and reuses their memory.

MKL, which torch uses for float32 products, is slow on AMD processors; oneDNN is not.
"""

import contextlib
import ctypes

import torch

_ONEDNN = torch.backends.mkldnn.is_available() and hasattr(torch.ops.mkldnn, "_linear_pointwise")


def product(a, b, more=None):
    """Return a @ b for matrices (m, k) and (k, n), or for stacks (s, m, k) and (s, k, n).

    ``more`` (m, n) is added to a product of matrices.
    """
    if more is not None:
        return torch.addmm(more, a, b) if a.is_cuda else more + product(a, b)
    if a.dim() == 3 and a.device.type == "cpu":
        return torch.stack([product(x, y) for x, y in zip(a, b, strict=True)])
    if _ONEDNN and a.dtype == torch.float32 and a.device.type == "cpu":
        return torch.ops.mkldnn._linear_pointwise(a, b.T, None, "none", [], "")
    return a @ b


def keep_freed_memory():
    """Make glibc keep freed blocks for the next step; with another C library do nothing.

    By default glibc returns the memory of every large intermediate result to the system,
    which has to clear the pages again when they are next used.
    """
    trim_threshold, mmap_threshold = -1, -3
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(mmap_threshold, 1 << 30)
        ctypes.CDLL(None).mallopt(trim_threshold, 2**31 - 1)

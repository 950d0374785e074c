"""Matrix products on the CPU, through oneDNN where torch has it, and memory for them.

MKL, which torch uses for float32 products, is slow on AMD's processors; oneDNN is
not.
"""

import contextlib
import ctypes

import torch

_ONEDNN = torch.backends.mkldnn.is_available() and hasattr(torch.ops.mkldnn, "_linear_pointwise")


def product(a, b, more=None):
    """Return a @ b of matrices (m, k) and (k, n), or of stacks (s, m, k) and (s, k, n) of them.

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
    """Tell glibc to keep freed blocks for the next step; elsewhere do nothing.

    By default it hands the megabytes of every intermediate back to the system, which
    clears them again page by page.
    """
    trim_threshold, mmap_threshold = -1, -3
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(mmap_threshold, 1 << 30)
        ctypes.CDLL(None).mallopt(trim_threshold, 2**31 - 1)

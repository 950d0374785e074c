"""Elementwise operations between a step's matrix products, and work on a second stream.

On a CPU the operations use this library's loops or torch's. On a GPU each is one Warp kernel
instead of several torch kernels, because a step there consists of many small kernels.
"""

from functools import cache

import torch

from pandis.engine import waves


def fused(values):
    """Return the Warp kernels for float32 values on a GPU; None for others, or without Warp."""
    return _kernels() if values.is_cuda and values.dtype == torch.float32 else None


@cache
def _kernels():
    try:
        # imported here: training on a CPU does not need Warp, which takes a second to load
        from pandis.engine.cuda import steps
    except (ImportError, RuntimeError):
        return None
    return steps if steps.ready() else None


def sines(z, bias):
    """Return sin(z + bias) and its cosine; z (w, n) is overwritten, bias is (w,)."""
    if kernels := fused(z):
        cosine = torch.empty_like(z)
        kernels.launch(kernels.sines, z.shape, z, bias, cosine)
        return z, cosine
    if z.device.type == "cpu" and z.dtype == torch.float32 and z.is_contiguous():
        cosine, bias = torch.empty_like(z), bias.contiguous()
        waves.sines(
            z.data_ptr(), bias.data_ptr(), cosine.data_ptr(), shape=z.shape,
            threads=torch.get_num_threads(),
        )  # fmt: skip
        return z, cosine
    z.add_(bias[:, None])
    cosine = torch.cos(z)
    return z.sin_(), cosine


def slopes_forward(along, chain, slope):
    """Return along · chain; then multiply ``along`` by ``slope`` in place."""
    if (kernels := fused(along)) and chain.shape == along.shape:
        to_slope = torch.empty_like(along)
        kernels.launch(kernels.slopes_forward, along.shape, along, chain, slope, to_slope)
        return to_slope
    to_slope = along * chain
    along *= slope
    return to_slope


def slopes_back(back, slope, to_slope, *, sine):
    """Set ``back`` to back · slope − to_slope · sine; a ``to_slope`` of None counts as 0.

    ``to_slope`` is overwritten.
    """
    if to_slope is None:
        back *= slope
    elif kernels := fused(back):
        kernels.launch(kernels.slopes_back, back.shape, back, slope, to_slope, sine)
    else:
        back *= slope
        back -= to_slope.mul_(sine)  # the derivative of the cosine is −sine


@cache
def _second_stream(device, first):
    """Return a second stream. One from torch could equal the first: torch hands out 32 in turn."""
    return _kernels().new_stream(device)


class Aside:
    """Runs work in parallel, on a second stream of a GPU.

    On a CPU, or without Warp, the work runs immediately.

    Parameters
    ----------
    values : Tensor
        A tensor on the device.
    """

    def __init__(self, values):
        self._stream, self._alive = None, []
        if values.is_cuda and fused(values):
            current = torch.cuda.current_stream()
            self._stream = _second_stream(current.device, current.cuda_stream)

    def __call__(self, work, *values):
        """Return ``work(*values)``; the values must not change before `join`."""
        if self._stream is None:
            return work(*values)
        self._alive.append(values)  # keeps their memory from being reused and overwritten
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            return work(*values)

    def join(self):
        """Make later work on the current stream wait for all work on the second one."""
        if self._stream is not None:
            torch.cuda.current_stream().wait_stream(self._stream)
            self._alive.clear()

"""Warp kernels for the parts of a training step that lie between matrix products.

One kernel replaces several of torch's. Arrays are torch tensors in single precision, with one
column per point, as in `pandis.pipeline.kinds.network.training.network`. Kernels are launched on
torch's current stream, so that a recorded CUDA graph contains them.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def sines(
    z: wp.array2d(dtype=wp.float32),
    bias: wp.array(dtype=wp.float32),
    cosine: wp.array2d(dtype=wp.float32),
):
    i, j = wp.tid()
    x = z[i, j] + bias[i]
    z[i, j] = wp.sin(x)
    cosine[i, j] = wp.cos(x)


@wp.kernel
def slopes_forward(
    along: wp.array2d(dtype=wp.float32),
    chain: wp.array2d(dtype=wp.float32),
    slope: wp.array2d(dtype=wp.float32),
    to_slope: wp.array2d(dtype=wp.float32),
):
    i, j = wp.tid()
    a = along[i, j]
    to_slope[i, j] = a * chain[i, j]
    along[i, j] = a * slope[i, j]


@wp.kernel
def slopes_back(
    back: wp.array2d(dtype=wp.float32),
    slope: wp.array2d(dtype=wp.float32),
    to_slope: wp.array2d(dtype=wp.float32),
    sine: wp.array2d(dtype=wp.float32),
):
    i, j = wp.tid()
    back[i, j] = back[i, j] * slope[i, j] - to_slope[i, j] * sine[i, j]


@wp.kernel
def regression(
    phi: wp.array(dtype=wp.float32),
    direction: wp.array2d(dtype=wp.float32),
    rows: wp.array2d(dtype=wp.float32),
    based: wp.bool,
    near: wp.float32,
    far: wp.float32,
    normal_weight: wp.float32,
    small: wp.float32,
    loss: wp.array(dtype=wp.float32),
    to_phi: wp.array(dtype=wp.float32),
    to_direction: wp.array2d(dtype=wp.float32),
):
    i = wp.tid()
    count = wp.float32(phi.shape[0])
    distance = rows[i, 3]
    off = phi[i] - distance
    turned = wp.vec3(direction[0, i], direction[1, i], direction[2, i])
    turned -= wp.vec3(rows[i, 4], rows[i, 5], rows[i, 6])
    if based:
        off += rows[i, 7]
        turned += wp.vec3(rows[i, 8], rows[i, 9], rows[i, 10])
    weight = near / (near + wp.abs(distance))
    of_value = wp.max(weight, far)
    of_normal = normal_weight * wp.max(weight, far / 3.0)
    length = wp.sqrt(wp.dot(turned, turned) + small * small)
    loss[i] = of_value * wp.abs(off) + of_normal * length
    to_phi[i] = of_value * wp.sign(off) / count if off != 0.0 else 0.0
    pull = of_normal / (length * count) * turned
    for k in range(3):
        to_direction[k, i] = pull[k]


def ready():
    """Return whether Warp finds a CUDA device."""
    return wp.is_cuda_available()


def new_stream(device):
    """Return a new, unshared stream on a torch device."""
    return wp.stream_to_torch(wp.Stream(wp.get_device(str(device))))


def launch(kernel, shape, *arguments):
    """Launch a kernel on tensors and numbers, on torch's current stream."""
    first = next(value for value in arguments if hasattr(value, "data_ptr"))
    device, stream = wp.get_device(str(first.device)), None
    if device.is_cuda:
        import torch

        stream = wp.stream_from_torch(torch.cuda.current_stream(first.device))
    inputs = [wp.from_torch(v) if hasattr(v, "data_ptr") else v for v in arguments]
    wp.launch(kernel, shape, inputs, device=device, stream=stream)

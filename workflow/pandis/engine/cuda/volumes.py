"""A kernel that fills a Warp volume with blocks of voxels."""

import warp as wp


@wp.kernel(enable_backward=False)
def fill(volume: wp.uint64, origins: wp.array(dtype=wp.vec3i), values: wp.array(dtype=wp.float32)):
    """Store one voxel; values are sorted by block, then by x, y and z."""
    i = wp.tid()
    at, local = origins[i // 512], i % 512
    x, y, z = at[0] + local // 64, at[1] + (local // 8) % 8, at[2] + local % 8
    wp.volume_store(volume, x, y, z, values[i])

"""Kernels that ask Warp for the sign of points, by each of its methods (see signs.py)."""

import warp as wp


@wp.kernel
def normal(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), signs: wp.array(dtype=float)):
    """Write the sign by the pseudonormal."""
    index = wp.tid()
    query = wp.mesh_query_point_sign_normal(mesh, points[index], 1.0e9)
    signs[index] = query.sign


@wp.kernel
def winding(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), signs: wp.array(dtype=float)):
    """Write the sign by the winding number."""
    index = wp.tid()
    query = wp.mesh_query_point_sign_winding_number(mesh, points[index], 1.0e9)
    signs[index] = query.sign


@wp.kernel
def parity(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), signs: wp.array(dtype=float)):
    """Write the sign by counting crossings of rays."""
    index = wp.tid()
    query = wp.mesh_query_point_sign_parity(mesh, points[index], 1.0e9)
    signs[index] = query.sign

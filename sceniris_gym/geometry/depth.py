"""A bound on the distance of points inside a closed mesh from its surface, which shortens containment tests."""

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Cells along the longest edge of a mesh's bounds: the bound is too large by half a cell's diagonal.
_CELLS = 24


@wp.kernel
def _measure_depth(
    mesh: wp.uint64,
    lower: wp.vec3,
    cell: float,
    most: float,
    # Out:
    depth: wp.array[float],
):
    i, j, k = wp.tid()
    at = lower + cell * wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5)
    query = wp.mesh_query_point_sign_winding_number(mesh, at, most)
    if query.result:
        if query.sign < 0.0:
            nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            wp.atomic_max(depth, 0, wp.length(nearest - at))


def most_depth(mesh: wp.Mesh, lower: np.ndarray, upper: np.ndarray, device: str) -> float:
    """Return a distance [m] from the surface that no point inside a closed mesh exceeds.

    Args:
        mesh: The mesh, with winding numbers.
        lower: Lower corner of its bounds [m], shape (3,).
        upper: Upper corner, likewise.
        device: Where it is.
    """
    cell = max(float((upper - lower).max()) / _CELLS, 1e-6)
    dim = np.maximum(np.ceil((upper - lower) / cell), 1).astype(int)
    depth = wp.zeros(1, dtype=float, device=device)
    most = float(np.linalg.norm(upper - lower))
    wp.launch(
        _measure_depth, dim=dim.tolist(), inputs=[mesh.id, wp.vec3(*lower), cell, most], outputs=[depth], device=device
    )
    # a point inside is within half a diagonal of its cell's centre, and of the surface if that centre lies outside
    return float(depth.numpy()[0]) + 0.5 * np.sqrt(3.0) * cell

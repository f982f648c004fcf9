"""Bounds of placed objects, seen from above, against shapely's rotated rectangles."""

import numpy as np
import shapely
import warp as wp
from shapely import affinity

from sceniris_gym.placement.placed import (
    bounds_corner,
    bounds_distance,
    bounds_extent,
    bounds_offset,
    bounds_radius,
    placed,
    rotated_to,
)

wp.set_module_options({"enable_backward": False})

N = 2000


@wp.kernel
def _measure(
    at: wp.array2d[wp.vec2],
    heading: wp.array2d[float],
    bounds: wp.array2d[wp.vec4],
    direction: wp.array[wp.vec2],
    # Out:
    corners: wp.array2d[wp.vec2],
    lengths: wp.array2d[float],
    extent: wp.array[wp.vec2],
    vector: wp.array[wp.vec2],
):
    i = wp.tid()
    a = placed(at[i, 0], heading[i, 0], bounds[i, 0])
    b = placed(at[i, 1], heading[i, 1], bounds[i, 1])
    for k in range(4):
        corners[i, k] = bounds_corner(a, k)
    lengths[i, 0] = bounds_distance(a, b)
    lengths[i, 1] = bounds_radius(a)
    lengths[i, 2] = bounds_offset(a)
    extent[i] = bounds_extent(a, direction[i])
    vector[i] = rotated_to(direction[i], a.axis)


def test_bounds_are_rectangles_of_shapely():
    """Corners, radius, offset of the pivot, extent along any direction, and the distance of two, near and far."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-0.3, 0.3, (N, 2, 2))
    heading = rng.uniform(-4.0, 4.0, (N, 2))
    low = rng.uniform(-0.3, 0.1, (N, 2, 2))  # the pivot lies outside of some
    bounds = np.concatenate([low, low + rng.uniform(0.0, 0.4, (N, 2, 2))], axis=2)
    angle = rng.uniform(-np.pi, np.pi, N)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inputs = [wp.array(a, dtype=kind, device="cpu") for a, kind in ((at, wp.vec2), (heading, float), (bounds, wp.vec4))]
    inputs.append(wp.array(direction, dtype=wp.vec2, device="cpu"))
    corners, lengths = wp.zeros((N, 4), dtype=wp.vec2, device="cpu"), wp.zeros((N, 3), dtype=float, device="cpu")
    extent, vector = (wp.zeros(N, dtype=wp.vec2, device="cpu") for _ in range(2))
    wp.launch(_measure, dim=N, inputs=inputs, outputs=[corners, lengths, extent, vector], device="cpu")
    expected = np.empty((N, 3))
    for i in range(N):
        a, b = (
            affinity.translate(
                affinity.rotate(shapely.box(*bounds[i, k]), heading[i, k], (0, 0), use_radians=True), *at[i, k]
            )
            for k in range(2)
        )
        pivot, ring = shapely.Point(at[i, 0]), shapely.get_coordinates(a)[:4]
        expected[i] = [a.distance(b), shapely.distance(pivot, shapely.points(ring)).max(), pivot.distance(a)]
        found = corners.numpy()[i]
        assert shapely.equals_exact(shapely.polygons(found).normalize(), a.normalize(), 1e-6)
        assert shapely.LinearRing(found).is_ccw
        along = (ring - at[i, 0]) @ direction[i]
        np.testing.assert_allclose(extent.numpy()[i], [along.min(), along.max()], atol=1e-6)
    np.testing.assert_allclose(lengths.numpy(), expected, atol=2e-6)
    assert 0.1 < (expected[:, 0] == 0.0).mean() < 0.9 and (expected[:, 2] > 0.0).mean() > 0.05
    turned = np.arctan2(vector.numpy()[:, 1], vector.numpy()[:, 0]) - angle - heading[:, 0]
    np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-6)

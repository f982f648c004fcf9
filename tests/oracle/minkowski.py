"""Signed distance of convex point sets from the hull of their Minkowski difference, in double precision."""

import numpy as np
import trimesh
from scipy.spatial import ConvexHull


def signed_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Return the distance [m] of the hulls of two point sets (n, 3), minus their depth of penetration if they meet.

    The hulls are as far apart as the origin is from the hull of all differences of their points.
    """
    differences = (first[:, None] - second[None]).reshape(-1, 3)
    hull = ConvexHull(differences)
    if (hull.equations[:, 3] <= 0).all():
        return float(hull.equations[:, 3].max())
    triangles = differences[hull.simplices]
    nearest = trimesh.triangles.closest_point(triangles, np.zeros((len(triangles), 3)))
    return float(np.linalg.norm(nearest, axis=1).min())

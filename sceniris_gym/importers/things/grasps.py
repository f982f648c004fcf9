"""Finds antipodal grasps: two fingers close on faces with opposite normals."""

from dataclasses import dataclass

import numpy as np

from sceniris_gym.geometry.rotations import matrix, quaternion
from sceniris_gym.importers.things.fit import points_on

OPENING = 0.08
"""Opening of the gripper [m], the narrowest among the shipped arms."""
MOST = 16
# Cosine of 15 degrees, the largest angle between a contact normal and the closing axis. Rubber pads hold larger angles.
_ALIGNED = 0.966
_TRIALS = 400  # candidate contact points of the first finger
_APPROACHES = 12  # approach directions about the closing axis
# The hand in its TCP's frame [m]: fingers (half width, thickness, palm to TCP, tip beyond TCP), and palm.
_FINGER = (0.011, 0.02, 0.038, 0.009)
_PALM = (0.032, 0.1, 0.1)  # half depth, half width, height
_ROOM = 0.005  # between an open finger and the surface
_FLOOR = 0.002  # between the hand and the support of the object


@dataclass(frozen=True)
class GraspSite:
    """A grasp: position [m] and orientation (wxyz) of the TCP, and the width [m] of the object between the fingers.

    The z axis of the TCP is the approach axis, and the y axis is the closing axis.
    """

    pos: np.ndarray
    quat: np.ndarray
    width: float


def antipodal_grasps(triangles: np.ndarray, points: np.ndarray) -> list[GraspSite]:
    """Find grasps of an object that stands at z = 0. The grasps are spread over the object.

    Args:
        triangles: Surface of the object [m], with normals that point outwards, shape (n, 3, 3).
        points: Points of the object that must be outside the open hand [m], shape (m, 3).
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    keep = area > 1e-12 * max(float(area.max(initial=0.0)), 1e-30)
    triangles, normals = triangles[keep], normals[keep] / area[keep][:, None]
    found = []
    for start, face in zip(*points_on(triangles, _TRIALS), strict=True):
        hit = _through(triangles, start, -normals[face])
        if hit is None or not 1e-3 < hit[0] < OPENING - _ROOM or normals[hit[1]] @ -normals[face] < _ALIGNED:
            continue
        middle = start - 0.5 * hit[0] * normals[face]
        found += _around(middle, normals[face], hit[0], points)
    return _spread(found, float(np.ptp(points, axis=0).max()))


def _through(triangles: np.ndarray, start: np.ndarray, direction: np.ndarray) -> tuple[float, int] | None:
    """Return the first triangle that a ray hits and the distance to it [m] (Moeller and Trumbore 1997).

    The ray starts on the surface of a solid and goes inwards, so the hit is on the opposite side of the solid.

    Args:
        triangles: Surface of the solid [m], shape (n, 3, 3).
        start: Start of the ray [m], shape (3,).
        direction: Direction of the ray, a unit vector, shape (3,).

    Returns:
        The distance and the index of the triangle, or None if the ray hits no triangle.
    """
    a, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, e2)
    det = (e1 * p).sum(axis=1)
    with np.errstate(all="ignore"):
        t0 = start - a
        u = (t0 * p).sum(axis=1) / det
        q = np.cross(t0, e1)
        v, t = (q @ direction) / det, (e2 * q).sum(axis=1) / det
        ahead = np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-5), t, np.inf)
    first = int(np.argmin(ahead))
    return (float(ahead[first]), first) if np.isfinite(ahead[first]) else None


def _around(middle: np.ndarray, closing: np.ndarray, width: float, points: np.ndarray) -> list[GraspSite]:
    """Return grasps at two opposite contacts, one for each approach direction. Grasps that collide are left out.

    Args:
        middle: Midpoint of the contacts [m], shape (3,).
        closing: The closing axis: direction from one contact to the other, shape (3,).
        width: Distance of the contacts [m].
        points: Points of the object that must be outside the open hand [m], shape (n, 3).
    """
    side = np.cross(closing, np.eye(3)[np.argmin(np.abs(closing))])
    side /= np.linalg.norm(side)
    other, found = np.cross(closing, side), []
    for angle in 2.0 * np.pi * np.arange(_APPROACHES) / _APPROACHES:
        approach = np.cos(angle) * side + np.sin(angle) * other
        axes = np.stack([np.cross(closing, approach), closing, approach], axis=1)
        if _is_clear((points - middle) @ axes, 0.5 * width + _ROOM, middle[2], axes[2]):
            found.append(GraspSite(middle, quaternion(axes), width))
    return found


def _is_clear(local: np.ndarray, gap: float, height: float, up: np.ndarray) -> bool:
    """Return whether no point is inside the open hand, and the hand is above the floor.

    Args:
        local: Points in the TCP frame [m], shape (n, 3).
        gap: Distance of each finger from the TCP [m].
        height: Height of the TCP above the floor [m].
        up: The up direction in the TCP frame, shape (3,).
    """
    half, thickness, palm, tip = _FINGER
    x, y, z = np.abs(local[:, 0]), np.abs(local[:, 1]), local[:, 2]
    fingers = (x < half) & (y > gap) & (y < gap + thickness) & (z > -palm) & (z < tip)
    hand = (x < _PALM[0]) & (y < _PALM[1]) & (z <= -palm) & (z > -palm - _PALM[2])
    reach = gap + thickness
    corners = [(x, y, z) for x in (-half, half) for y in (-reach, reach) for z in (-palm, tip)]
    corners += [(x, y, -palm - _PALM[2]) for x in (-_PALM[0], _PALM[0]) for y in (-_PALM[1], _PALM[1])]
    return not (fingers | hand).any() and bool((np.array(corners) @ up).min() + height > _FLOOR)


def _spread(found: list[GraspSite], size: float) -> list[GraspSite]:
    """Select up to `MOST` grasps: the most vertical grasp, then repeatedly the grasp farthest from the selected grasps.

    The distance of two grasps depends on their positions, divided by the object's `size` [m], and on their rotations.
    """
    if not found:
        return []
    features = np.array([np.concatenate([g.pos / size, matrix(g.quat).ravel() * 0.5]) for g in found])
    swapped = np.array([np.concatenate([g.pos / size, (matrix(g.quat) * [-1, -1, 1]).ravel() * 0.5]) for g in found])
    chosen = [int(np.argmin([matrix(g.quat)[2, 2] for g in found]))]  # the one closest to straight down
    away = np.full(len(found), np.inf)
    while len(chosen) < min(MOST, len(found)):
        last = chosen[-1]
        away = np.minimum(away, np.linalg.norm(features - features[last], axis=1))
        away = np.minimum(away, np.linalg.norm(swapped - features[last], axis=1))  # swapped fingers: same grasp
        if away.max() < 0.05:
            break
        chosen.append(int(np.argmax(away)))
    return [found[i] for i in chosen]

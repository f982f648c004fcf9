"""Places a camera so that it just sees some points, and finds upright boxes around geoms."""

import mujoco
import numpy as np

_MARGIN = 1.04
_UP = np.array([0.0, 0.0, 1.0])


def frame(points: np.ndarray, backward: np.ndarray, fovy: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Place a camera so that it just sees all points.

    Let (u, v, t) be the position of the eye in the camera's axes. A point (x, y, z) in these axes is seen if
    |x - u| <= (t - z) tan(fovx / 2), and the same for y and v. The camera takes the least t that has a solution, then
    the middle of the possible intervals of u and v.

    Args:
        points: The points to see [m], world frame, shape (n, 3).
        backward: Direction from the points to the eye, shape (3,).
        fovy: Vertical field of view [degrees].
        aspect: Width of the picture over its height.

    Returns:
        Position (3,) [m] and axes (3, 3) of the camera, with columns right, up and backward.
    """
    axes = camera_axes(backward)
    local = points @ axes
    slope = np.tan(np.radians(fovy) / 2) * np.array([aspect, 1.0]) / _MARGIN
    near = (local[:, :2] + slope * local[:, 2:]).max(0)
    far = (local[:, :2] - slope * local[:, 2:]).min(0)
    away = float(((near - far) / (2 * slope)).max())
    return axes @ np.array([*(near + far) / 2, away]), axes


def camera_axes(backward: np.ndarray, up: np.ndarray = _UP) -> np.ndarray:
    """Return the axes of a camera that looks against `backward`, shape (3, 3): right, up as far as possible, backward.

    Args:
        backward: Direction opposite to the viewing direction, of any length, shape (3,).
        up: Direction that should point up in the picture, not parallel to `backward`, shape (3,).
    """
    backward = backward / np.linalg.norm(backward)
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward], axis=1)


def box_corners(center: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the eight corners [m] of an upright box, shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return center + signs * half


def geom_corners(mjm: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """Return the corners [m] of the bounding boxes of n geoms, world frame, shape (8 n, 3)."""
    found = [np.zeros((0, 3))]
    for geom in geoms:
        box = box_corners(mjm.geom_aabb[geom, :3], mjm.geom_aabb[geom, 3:])
        found.append(box @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(found)


def upright_box(mjm: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner [m] of the box along the world's axes that encloses all given geoms.

    Args:
        mjm: The model.
        data: State of the model, with up-to-date poses of the geoms.
        geoms: Ids of at least one geom. Planes are not allowed.
    """
    mats = data.geom_xmat[geoms].reshape(-1, 3, 3)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", mats, mjm.geom_aabb[geoms, :3])
    half = np.einsum("gij,gj->gi", np.abs(mats), mjm.geom_aabb[geoms, 3:])
    return (middle - half).min(axis=0), (middle + half).max(axis=0)

"""The overview camera of a scene, placed so that robots do not hide objects, and the geoms that pictures show.

`frame` places any camera so that given points fill its picture.
"""

import copy
from functools import cached_property

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.member_names import split_support
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.assemble import MARK_GROUP
from sceniris_gym.scene.support import subtree

_MARGIN = 1.04
_UP = np.array([0.0, 0.0, 1.0])


def frame(points: np.ndarray, backward: np.ndarray, fovy: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Place a camera as near as possible, but so that its picture shows all points.

    Let (u, v, t) be the position of the eye in the camera's axes. A point (x, y, z) in these axes is seen if
    |x - u| <= (t - z) tan(fovx / 2) and |y - v| <= (t - z) tan(fovy / 2). The camera takes the least t
    that has a solution, then the middle of the possible intervals of u and v.

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
    return center + half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def local_corners(mjm: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the corners [m] of a geom's bounding box in the geom's frame, shape (8, 3). A plane's box is flat."""
    if mjm.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
        return box_corners(np.zeros(3), mjm.geom_size[geom] * [1, 1, 0])
    return box_corners(mjm.geom_aabb[geom, :3], mjm.geom_aabb[geom, 3:])


def geom_corners(mjm: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """Return the corners [m] of the bounding boxes of n geoms, world frame, shape (8 n, 3)."""
    found = [local_corners(mjm, i) @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i] for i in geoms]
    return np.concatenate([np.zeros((0, 3)), *found])


def framed(mjm: mujoco.MjModel) -> np.ndarray:
    """Return which geoms a camera has to see whole, shape (ngeom,): no grounds (planes), and no scenery.

    Scenery, such as the walls of a room, is a tree of bodies that cannot move and does not collide.
    """
    roots = mjm.body_rootid[mjm.geom_bodyid]
    collide = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    moved = mjm.body_rootid[[*mjm.jnt_bodyid, *np.flatnonzero(mjm.body_mocapid >= 0)]]
    return (mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & np.isin(roots, [*roots[collide], *moved])


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


VISIBLE_GROUPS = (0, 1, 2, MARK_GROUP)
"""Geom groups in pictures: the visible groups of MuJoCo's viewer, and markers."""
HIDDEN_GROUP = 5
FOVY = 40.0
"""Vertical field of view [degrees]."""
_ASPECT = 4.0 / 3.0
# Headings from the scene to the eye, seen from above. The first within `_NEARLY` of the best is used.
_HEADINGS = (
    *((0.45, -1.0), (-0.45, -1.0), (1.0, -0.45), (-1.0, -0.45)),
    *((0.45, 1.0), (-0.45, 1.0), (1.0, 0.45), (-1.0, 0.45)),
)
_NEARLY = 0.05
# Slopes of the view: steep enough to see into a drawer over its front, and the slope for scenes without drawers.
_INTO_DRAWERS, _ELSEWHERE = np.tan(np.radians(62.0)), np.tan(np.radians(42.0))
_SHOWN = (0, 1, 2)
_GRID = np.linspace(0.1, 0.9, 4)

_Box = tuple[np.ndarray, np.ndarray]


class Overview:
    """The view of the overview camera: all places that objects may have, and all other geoms except scenery.

    Args:
        config: The scene.
        mjm: The scene's model.
        home_qpos: The start pose, shape (nq,).
    """

    def __init__(self, config: SceneConfig, mjm: mujoco.MjModel, home_qpos: np.ndarray) -> None:
        self.config, self.mjm = config, mjm
        self.data = mujoco.MjData(mjm)
        self.data.qpos[:] = home_qpos
        mujoco.mj_kinematics(mjm, self.data)
        self.shown = np.isin(mjm.geom_group, _SHOWN) & (mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
        placed = [self._body(part.body or name) for name, part in config.parts.items() if part.is_placed]
        self.of_placed = np.isin(mjm.geom_bodyid, [body for root in placed for body in subtree(mjm, root)])

    def camera(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the pose of a camera that sees the scene: position (3,) [m] and axes (3, 3): right, up, backward."""
        carriers = [
            self._body(part.support.parent) for part in self.config.objects.values() if part.support is not None
        ]
        slides = np.isin(self.mjm.jnt_bodyid[self.mjm.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE], carriers).any()
        steep = _INTO_DRAWERS if slides else _ELSEWHERE
        backward = [np.array([x, y, steep * np.hypot(x, y)]) for x, y in _HEADINGS]
        points = self.seen(framed(self.mjm))
        cameras = [frame(points, direction, FOVY, _ASPECT) for direction in backward]
        if not self.config.all_robots or not self.places:
            return cameras[0]
        shares = self._shares_seen([eye for eye, _ in cameras])
        return cameras[int(np.flatnonzero(shares >= shares.max() - _NEARLY)[0])]

    def seen(self, geoms: np.ndarray | bool = True) -> np.ndarray:
        """Return points that a camera has to see [m], shape (n, 3): corners of boxes.

        The boxes enclose the places that objects may have, and the geoms that are not part of a placed object, of those
        in the mask `geoms`, shape (ngeom,).
        """
        corners = geom_corners(self.mjm, self.data, np.flatnonzero(self.shown & ~self.of_placed & geoms))
        boxes = [box_corners((low + high) / 2.0, (high - low) / 2.0) for low, high in self.places]
        if not len(corners) and not boxes:
            half = [0.5, 0.5] if self.config.floor is None else np.array(self.config.floor.size) / 2.0
            boxes = [box_corners(np.zeros(3), np.array([*half, 0.0]))]
        return np.concatenate([corners, *boxes])

    @cached_property
    def places(self) -> list[_Box]:
        """The places that objects may have."""
        return [box for name in self.config.parts if (box := self._box(name)) is not None]

    def _shares_seen(self, eyes: list[np.ndarray]) -> np.ndarray:
        """Return, for each eye, the fraction of places that no geom hides. Geoms of placed objects are ignored."""
        mjm = copy.copy(self.mjm)
        mjm.geom_group[self.of_placed] = HIDDEN_GROUP
        groups, hit = np.isin(np.arange(6), _SHOWN).astype(np.uint8), np.zeros(1, np.int32)
        # many objects have the same place: on each body of each variant of a support
        boxes, counts = np.unique(self.places, axis=0, return_counts=True)
        shares = np.array([[x, y, 0.9] for x in _GRID for y in _GRID])
        points = [low + (high - low) * share for low, high in boxes for share in shares]
        far = [[mujoco.mj_ray(mjm, self.data, at, eye - at, groups, 1, -1, hit, None) for at in points] for eye in eyes]
        return np.average(np.array(far) < 0.0, axis=1, weights=counts.repeat(len(shares)))

    def _box(self, name: str) -> _Box | None:
        """Return a box around all places of an object: the range of the pivot, enlarged by part of the object's size.

        Return None if the object is not placed, or its support is unknown.
        """
        part = self.config.parts[name]
        if not part.is_placed:
            return None
        corners = None if part.region is None else part.region.corners
        if part.support is None:
            low, high = np.array(corners, float)
            return low, high
        region = None if corners is None else np.array(corners, float)[:, :2]
        if (base := self._support(part.support.parent, region)) is None:
            return None
        low, high = base
        radius, height = self._size(self._body(part.body or name))
        half = (high - low)[:2] / 2.0
        beyond = np.array([*np.maximum(radius / 2.0, radius - half / 2.0), 0.0])
        return low - beyond, np.array([*high[:2], low[2] + height]) + beyond

    def _support(self, parent: str, region: np.ndarray | None) -> _Box | None:
        """Return the range of the pivots of objects on a support, as a flat box: `region`, or the top of the support.

        Return None if the support is unknown.
        """
        if parent == FLOOR and self.config.floor is not None:
            half = np.array(self.config.floor.size) / 2.0
            low, high = (-half, half) if region is None else region
            return np.array([*low, 0.0]), np.array([*high, 0.0])
        owner = split_support(parent, self.config.parts)[0]
        body = self._body(parent)
        if body < 0:
            return None
        if owner in self.config.parts and self.config.parts[owner].is_placed:
            box = self._box(owner)
            return None if box is None else (box[0], np.array([*box[1][:2], box[0][2]]))
        geoms = np.flatnonzero((self.mjm.geom_bodyid == body) & self.shown)
        points = geom_corners(self.mjm, self.data, geoms) if len(geoms) else self.data.xpos[body][None]
        low, high = points.min(axis=0), points.max(axis=0)
        if region is not None:
            flat = np.array([[x, y, 0.0] for x in region[:, 0] for y in region[:, 1]])
            flat = flat @ self.data.xmat[body].reshape(3, 3).T + self.data.xpos[body]
            low[:2], high[:2] = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
        return np.array([*low[:2], high[2]]), high

    def _size(self, root: int) -> tuple[float, float]:
        """Return the radius [m] of an object around its root, seen from above at home, and its height [m]."""
        geoms = np.flatnonzero(np.isin(self.mjm.geom_bodyid, subtree(self.mjm, root)) & self.shown)
        if not len(geoms):
            return 0.0, 0.0
        corners = geom_corners(self.mjm, self.data, geoms) - self.data.xpos[root]
        return float(np.linalg.norm(corners[:, :2], axis=1).max()), float(np.ptp(corners[:, 2]))

    def _body(self, name: str) -> int:
        return mujoco.mj_name2id(self.mjm, mujoco.mjtObj.mjOBJ_BODY, name)


def picture_groups(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the geom group of each geom for pictures, shape (ngeom,). Geoms only for collisions get HIDDEN_GROUP.

    A colliding geom is only for collisions if its body also has visible geoms without collisions in another group.
    Geoms of the world body always appear, because visual geoms of the world do not replace its floor.
    """
    groups = mjm.geom_group.copy()
    visible = np.isin(groups, VISIBLE_GROUPS) & (mjm.geom_rgba[:, 3] > 0.0)
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    looks = set(zip(mjm.geom_bodyid[visible & ~collides], groups[visible & ~collides], strict=True))
    bodies = {body for body, _ in looks} - {0}
    for geom in np.flatnonzero(visible & collides):
        body = int(mjm.geom_bodyid[geom])
        if body in bodies and (body, groups[geom]) not in looks:
            groups[geom] = HIDDEN_GROUP
    return groups

"""Grasps of an object: TCP poses that an arm should be able to reach.

A grasp is a pose of the TCP, midway between the fingertips. Its +z axis is the approach axis, and its +y axis is the
closing axis. An asset defines grasps as sites `grasp_*`. Because the gripper's two fingers are interchangeable, each
site also gives a second grasp, rotated by 180 degrees about the approach axis. If an asset has no such sites, grasps
are generated from its geometry for each stable pose. They come from above, with 8 yaws and tilts of 0, 15, 30 and 45
degrees, and also from the side if the object is taller than wide. A round object has 360 yaws for a hand that cannot
turn. Grasps that need more than the gripper's widest opening are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fnmatch import fnmatchcase
from itertools import compress
from typing import NamedTuple

import numpy as np

from sceniris_gym.errors import GraspError, SceneKeyError, UnknownNameError
from sceniris_gym.files import Array
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.geometry.resting_poses import StablePose
from sceniris_gym.geometry.rotations import matrix, product, quaternion
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree

PREFIX = "grasp_"
_ROLLED = " rolled"
YAWS, ROUND_YAWS = 8, 360
"""Number of yaws of generated grasps. A hand that cannot turn gets the second number for an object that is round: its
yaw follows from the object's place, within the 0.5 degrees of inverse kinematics."""
TILTS = (0.0, 15.0, 30.0, 45.0)  # degrees from the vertical
_SIDE = 90.0
MOST_RISING = math.sin(math.radians(10.0))
"""Largest z component of an approach axis. The axis may point upwards by 10 degrees. If it were steeper, the gripper
would come from below, through the support."""
# Clearance between the fingertips and the support, and between the object and the palm [m].
_ABOVE = 0.002
# Widths of a round object in these three directions (columns) differ by at most this fraction.
_ACROSS, _ROUND = np.vstack([*(turn(np.radians([0.0, 30.0, 75.0])) for turn in (np.cos, np.sin)), np.zeros(3)]), 0.02
# Rotations of an object after which its axis +z, -z, +x, -x, +y or -y points up.
_UPS = ((1, 0, 0, 0), (0, 1, 0, 0), (1, 0, -1, 0), (1, 0, 1, 0), (1, 1, 0, 0), (1, -1, 0, 0))


class Grasp(NamedTuple):
    """A pose of the TCP in the frame of one of the object's bodies.

    Attributes:
        name: Name of the site. The second grasp of a site has the suffix " rolled". A generated grasp is called "top",
            "tilt 15", ... or "side", followed by the yaw in degrees, such as "tilt 15 90".
        body: Id of the body.
        pos: Position [m] in the body's frame, shape (3,).
        quat: Orientation, wxyz.
        opening: Opening [m] that the gripper needs to fit around the object.
    """

    name: str
    body: int
    pos: Array
    quat: Array
    opening: float


class GraspSet(NamedTuple):
    """All grasps of an object, grouped by its stable poses.

    Attributes:
        grasps: The grasps. The test for reachability tries them in this order.
        spans: For each stable pose of the object, the index of its first grasp in `grasps` and its number of grasps.
    """

    grasps: tuple[Grasp, ...]
    spans: tuple[tuple[int, int], ...]

    def among(self, kept: np.ndarray) -> GraspSet:
        """Return only the grasps that a mask keeps, shape (ngrasp,), bool."""
        before = [0, *np.cumsum(kept).tolist()]
        spans = tuple((before[first], before[first + num] - before[first]) for first, num in self.spans)
        return GraspSet(tuple(compress(self.grasps, kept)), spans)


class Graspable:
    """An object in its start pose, as triangles in the frame of its root.

    Args:
        scene: The scene.
        name: The object.
        pieces: Pieces of all geoms of the scene.
        gripper: The gripper that grasps the object.
        turns: Whether the arm can turn the hand about its approach axis.
    """

    def __init__(self, scene: SceneModel, name: str, pieces: list[Piece], gripper: Gripper, turns=True) -> None:
        self.name, self.scene, self._home, self._gripper, self._turns = name, scene, scene.home, gripper, turns
        self.bodies = scene.subtree(name)
        self.root = self.bodies[0]
        meshes = [
            self._to_root(p.body, p.mesh.vertices)[p.mesh.faces]
            for p in pieces
            if p.body in self.bodies and p.mesh is not None
        ]
        self.triangles = np.concatenate([np.zeros((0, 3, 3)), *meshes])
        self.center = self._to_root(0, self._home.subtree_com[self.root][None])[0]

    def grasp_set(self, poses: list[StablePose]) -> GraspSet:
        """Return the grasps that fit the gripper, from the asset's sites or generated from its geometry.

        A stable pose without a suitable grasp has 0 grasps in `GraspSet.spans`, so no layout accepts it. If the object
        has the key `grasp`, the names of its grasps match this glob, or they are at the part with this name. If no site
        does, generated grasps are used.

        Args:
            poses: Stable poses of the object.

        Raises:
            UnknownNameError: No grasp matches `grasp`.
            SceneKeyError: The object lacks the part that `grasp` names.
            GraspError: No grasp fits the gripper.
        """
        config, gripper, sites = self.scene.config.objects[self.name], self._gripper, self._sites()
        is_any = config.drawn_orientation.kind == "any"  # any side may be up
        word = "*" if config.grasp is None else config.grasp
        own = selected(self.scene, self.name, sites, word)
        made = [] if own else [self._made(pose, is_any) for pose in poses]
        groups = [own] if own else [selected(self.scene, self.name, group, word) for group in made]
        known = {g.name.removesuffix(_ROLLED).removeprefix(PREFIX) for group in (sites, *made) for g in group}
        where = f"{self.scene.config.where}: objects.{self.name}"
        if word in config.parts and word not in self.scene.joints(self.name):
            raise SceneKeyError(f"{where}.grasp: it lacks the part '{word}'. Leave out this variant, or 'grasp'.")
        if known and not any(groups):
            raise UnknownNameError("grasp", word, f"{where}.grasp", known | ({*config.parts} - {word}))
        kept = [[g for g in group if g.opening <= gripper.opening] for group in groups]
        if not any(kept):
            needed = min((g.opening for group in groups for g in group), default=None)
            why = "no grasp has a part of the object between the fingers along +z of the robot's `tcp`"
            if needed is not None:
                opens = f"but the gripper opens to {gripper.opening:.3g} m"
                why = f"its narrowest grasp needs an opening of {needed:.3g} m, {opens}"
            raise GraspError(
                f"{where}.reachable: {why}. Give the asset sites 'grasp_*' "
                "where it can be grasped (+z the approach axis, +y the closing axis), or use a smaller object.",
                needed,
                gripper.opening,
            )
        if own:
            return GraspSet(tuple(kept[0]), ((0, len(kept[0])),) * len(poses))
        grasps, adr, num = ranges(kept)
        return GraspSet(tuple(grasps), tuple(zip(adr.tolist(), num.tolist(), strict=True)))

    def _sites(self) -> list[Grasp]:
        mjm, found = self.scene.mjm, []
        for local, i in self.scene.sites(self.name).items():
            name, body = local.rsplit("/", 1)[-1], int(mjm.site_bodyid[i])
            if not name.startswith(PREFIX):
                continue
            pos = self._to_root(body, mjm.site_pos[i][None])[0]
            axes = self._mat(body) @ matrix(mjm.site_quat[i])
            between = section(self.triangles, pos, axes, self._gripper)
            opening = 0.0 if between is None else 2.0 * max(abs(between[0]), abs(between[1]))
            found.append(Grasp(name, body, mjm.site_pos[i].copy(), mjm.site_quat[i].copy(), opening))
        rotation = np.array([0.0, 0.0, 0.0, 1.0])
        return found + [g._replace(name=f"{g.name}{_ROLLED}", quat=product(g.quat, rotation)) for g in found]

    def _made(self, pose: StablePose, is_any: bool) -> list[Grasp]:
        if is_any:
            ups = [matrix(np.array(up) / np.linalg.norm(up)) for up in _UPS]
            return [g for up in ups for g in self._from_above(up, (0.0,))]
        rotation = matrix(pose.quat)
        found = self._from_above(rotation, TILTS)
        low, high = _extents(self.triangles @ rotation.T)
        if high[2] - low[2] > max(high[:2] - low[:2]):
            found += self._from_above(rotation, (_SIDE,))
        return found

    def _from_above(self, rotation: np.ndarray, tilts: tuple[float, ...]) -> list[Grasp]:
        """Return grasps of the object in an orientation, for several tilts and all yaws.

        Args:
            rotation: Orientation of the object's root, shape (3, 3).
            tilts: Angles between straight down and the approach axis [degrees].
        """
        widths = np.subtract(*_extents(self.triangles @ rotation.T @ _ACROSS))
        found, num = [], YAWS if self._turns or np.ptp(widths) > -_ROUND * widths.min() else ROUND_YAWS
        for tilt in tilts:
            for yaw in np.arange(num) * 360.0 / num:
                axes = rotation.T @ tcp_axes(yaw, tilt)
                made = self._at_center(rotation, axes, tilt)
                if made is not None:
                    word = "top" if tilt == 0.0 else "side" if tilt == _SIDE else f"tilt {tilt:g}"
                    found.append(Grasp(f"{word} {yaw:g}", self.root, made[0], quaternion(axes), made[1]))
        return found

    def _at_center(self, rotation: np.ndarray, axes: np.ndarray, tilt: float) -> tuple[np.ndarray, float] | None:
        """Put a grasp at the centre of the object.

        Args:
            rotation: Orientation of the object's root, shape (3, 3).
            axes: Axes of the TCP in the root's frame as columns, shape (3, 3).
            tilt: Angle between straight down and the approach axis [degrees].

        Returns:
            Position of the TCP in the root's frame [m] and the opening that the grasp needs [m]. None if no part of the
            object is between the fingers.
        """
        if not len(self.triangles):
            return np.zeros(3), 0.0
        gripper, (low, high) = self._gripper, _extents(self.triangles @ rotation.T)
        at = rotation @ self.center
        deepest = gripper.depth - _ABOVE
        if tilt == _SIDE:
            at[2] = max(0.5 * (low[2] + high[2]), low[2] + gripper.half_width + _ABOVE)
            near, far = _ahead(self.triangles, rotation.T @ at, axes, gripper)
            at += (rotation @ axes[:, 2]) * (near + min(0.5 * (far - near), deepest))
        else:
            slope = np.radians(tilt)
            fingers = gripper.tip * np.cos(slope) + gripper.half_width * np.sin(slope) + _ABOVE
            at[2] = max(high[2] - min(0.5 * (high[2] - low[2]), deepest), low[2] + fingers)
        pos = rotation.T @ at
        between = section(self.triangles, pos, axes, gripper)
        if between is None:
            return None
        width, (first, slope) = between[1] - between[0], gripper.middle
        return pos + axes[:, 1] * (0.5 * (between[0] + between[1]) - (first + slope * width)), width

    def _mat(self, body: int) -> np.ndarray:
        """Return the rotation matrix (3, 3) from a body's frame to the root's frame."""
        return self._home.xmat[self.root].reshape(3, 3).T @ self._home.xmat[body].reshape(3, 3)

    def _to_root(self, body: int, points: np.ndarray) -> np.ndarray:
        """Transform points (n, 3) from a body's frame (0: the world frame) to the root's frame."""
        return points @ self._mat(body).T + self._mat(0) @ (self._home.xpos[body] - self._home.xpos[self.root])


def selected(scene: SceneModel, owner: str, grasps: Iterable[Grasp], word: str) -> list[Grasp]:
    """Return the grasps of an object that the word `grasp` selects.

    The word is a part of the object, for the grasps at bodies that its joint moves, or a glob of the grasps' names,
    with or without 'grasp_'. The suffix " rolled" is ignored.
    """
    if word in scene.config.objects[owner].parts:
        joint = scene.joints(owner).get(word)
        bodies = [] if joint is None else subtree(scene.mjm, int(scene.mjm.jnt_bodyid[joint]))
        return [grasp for grasp in grasps if grasp.body in bodies]
    names = ((grasp, grasp.name.removesuffix(_ROLLED)) for grasp in grasps)
    return [g for g, name in names if fnmatchcase(name, word) or fnmatchcase(name.removeprefix(PREFIX), word)]


def tcp_axes(yaw: float, tilt: float) -> np.ndarray:
    """Return the axes of a TCP as columns (3, 3). The TCP is tilted about its closing axis, then turned by the yaw.

    Args:
        yaw: Angle from the y axis to the closing axis, about the vertical [degrees].
        tilt: Angle from straight down to the approach axis [degrees]. At 90, the approach axis is horizontal.
    """
    s, c = np.sin(np.radians(tilt)), np.cos(np.radians(tilt))
    down = np.array([[-c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, -c]])
    s, c = np.sin(np.radians(yaw)), np.cos(np.radians(yaw))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ down


def section(triangles: np.ndarray, pos: np.ndarray, axes: np.ndarray, gripper: Gripper) -> tuple[float, float] | None:
    """Return the extent, along the closing axis, of the part of an object that is between the fingers.

    This part is as wide as the fingers and ends at the fingertips. If a finger fits into a gap in this part, only the
    piece nearest to the TCP counts.

    Args:
        triangles: Closed surfaces of the object [m], shape (n, 3, 3).
        pos: Position of the TCP in the frame of the triangles [m], shape (3,).
        axes: Axes of the TCP in this frame as columns, shape (3, 3).
        gripper: The gripper.

    Returns:
        Smallest and largest coordinate [m] relative to the TCP, or None if no part is between the open fingers.
    """
    spans = _clipped(triangles, pos, axes, gripper.half_width, gripper.tip)[:, 1]
    if not len(spans):
        return None
    spans = spans[np.argsort(spans[:, 0], kind="stable")]
    high = np.maximum.accumulate(spans[:, 1])
    starts = np.concatenate([[True], spans[1:, 0] > high[:-1] + gripper.thickness])
    low, high = spans[starts, 0], np.maximum.reduceat(spans[:, 1], np.flatnonzero(starts))
    off = np.maximum(np.maximum(low, -high), 0.0)
    best = int(np.argmin(off))
    return (float(low[best]), float(high[best])) if off[best] < 0.5 * gripper.opening else None


def _ahead(triangles: np.ndarray, pos: np.ndarray, axes: np.ndarray, gripper: Gripper) -> tuple[float, float]:
    """Return the least and the greatest distance [m] of an object from the TCP, along the approach axis.

    Only the part of the object within the fingers' width counts. The arguments are as in `section`.
    """
    spans = _clipped(triangles, pos, axes, gripper.half_width, np.inf)[:, 2]
    return (float(spans[:, 0].min()), float(spans[:, 1].max())) if len(spans) else (0.0, 0.0)


def _clipped(triangles: np.ndarray, pos: np.ndarray, axes: np.ndarray, half_width: float, tip: float) -> np.ndarray:
    """Clip triangles to |x| <= half_width and z <= tip in the TCP frame. Return the extents of the clipped triangles.

    The corners of a clipped triangle are found among these points: the triangle's vertices, the intersections of its
    edges with the three planes, and its intersections with the two lines in which the planes meet.

    Returns:
        Smallest and largest coordinate of each clipped triangle along each axis of the TCP [m], shape (n, 3, 2).
        Triangles that are completely clipped are dropped.
    """
    local = (triangles - pos) @ axes
    low, high = local.min(axis=1), local.max(axis=1)
    local = local[(low[:, 0] <= half_width) & (high[:, 0] >= -half_width) & (low[:, 2] <= tip)]
    points = [local, *(_crossings(local, 0, x) for x in (-half_width, half_width))]
    if np.isfinite(tip):
        points += [_crossings(each, 2, tip) for each in points]  # of the triangle, and of its sections with the sides
    corners = np.concatenate(points, axis=1)
    slack = 1e-9
    inside = (np.abs(corners[..., 0]) <= half_width + slack) & (corners[..., 2] <= tip + slack)
    kept = inside.any(axis=1)
    corners, inside = corners[kept], inside[kept]
    low = np.where(inside[..., None], corners, np.inf).min(axis=1)
    high = np.where(inside[..., None], corners, -np.inf).max(axis=1)
    return np.stack([low, high], axis=-1)


def _crossings(triangles: np.ndarray, axis: int, value: float) -> np.ndarray:
    """Return the point where each edge of triangles (n, 3, 3) crosses a plane, shape (n, 3, 3). NaN for no crossing.

    The plane contains the points whose coordinate along `axis` (0, 1 or 2) is `value` [m].
    """
    other = np.roll(triangles, -1, axis=1)
    a, b = triangles[..., axis] - value, other[..., axis] - value
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(a * b <= 0.0, a / (a - b), np.nan)
    return triangles + t[..., None] * (other - triangles)


def _extents(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points = triangles.reshape(-1, 3) if len(triangles) else np.zeros((1, 3))
    return points.min(axis=0), points.max(axis=0)

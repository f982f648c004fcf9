"""Finds the arms of a model with their tool centre points, and its supports with their names in a scene."""

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import shapely

from sceniris_gym.config.robot import TcpConfig
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.supports import SupportSurface, level_surfaces
from sceniris_gym.scene.overview import geom_corners, upright_box
from sceniris_gym.scene.support import Support, is_static, static_supports, subtree
from sceniris_gym.scene.tcp import USUAL

# An arm has at least this number of joints, and of bodies with joints: fewer bodies imitate a freejoint.
_LEAST_JOINTS, _LEAST_LINKS = 4, 3
# A branch continues the arm if it has at least this number of joints in a row, and more than twice the joints of any
# other branch: a shorter branch may be a neck or a bellows.
_LEAST_BRANCH = 3
# A finger has at most this number of joints in a row. A longer branch may be an arm of a torso.
_MOST_FINGER = 5
# A site is a tool centre point if its name contains one of these words, best first.
_TCP_WORDS = (*USUAL, "gripsite", "grasp", "attachment", "eef", "end_effector", "tool")
# A hinge at the end of an arm moves a finger if the name of its body contains one of these words.
_FINGER_WORDS = ("jaw", "finger", "claw", "mover")
# Distance of the tool centre point behind the fingertips [m].
_TIP = 0.01
# Fingers centred within this distance of the hand's origin do not indicate an approach direction [m].
_AT_ORIGIN = 0.03
# A site is a tool centre point if it is in the box around the fingers, or up to this distance outside [m].
_BESIDE = 0.03
# The approach axis snaps to an axis of the frame within this angle [deg].
_CLOSE = 15.0
_GEOM = mujoco.mjtObj.mjOBJ_GEOM


@dataclass(frozen=True)
class FoundArm:
    """An arm in a model.

    Attributes:
        mjm: The model.
        base: Root body of the arm, a child of the world.
        hand: Last body of the arm's chain of joints.
        joints: Ids of the joints in this chain, from the base to the hand.
        fingers: Bodies below the hand that finger joints move. Empty for an arm without fingers.
    """

    mjm: mujoco.MjModel
    base: int
    hand: int
    joints: tuple[int, ...]
    fingers: tuple[int, ...]

    @cached_property
    def palm(self) -> tuple[int, ...]:
        """The hand and all bodies that are fixed to the hand."""
        welded = self.mjm.body_weldid == self.mjm.body_weldid[self.hand]
        return tuple(b for b in subtree(self.mjm, self.hand) if welded[b])

    def tcp(self, data: mujoco.MjData) -> TcpConfig:
        """Return a tool centre point (TCP) for the arm, as the value of `tcp` in a scene file.

        If the hand has a site with a name such as 'tcp' near its fingers, the TCP is at that site. Otherwise, the TCP
        is between the fingertips, or, for an arm without fingers, at the origin of the last body. The +z axis of the
        TCP points from the hand to the fingers, away from the last joint. If there are no fingers, or if they are at
        the hand's origin, +z is along the axis of the last joint.

        Args:
            data: The model in its start pose, after `mj_kinematics`.
        """
        own = [s for s in range(self.mjm.nsite) if self.mjm.site_bodyid[s] in self.palm]
        body, offset, toward = self.hand if self.fingers else self.palm[-1], [0.0, 0.0, 0.0], np.zeros(3)
        mat, pos = data.xmat[body].reshape(3, 3), data.xpos[body]
        points = (_points(self.mjm, data, self.fingers or (body,)) - pos) @ mat
        middle, half = (points.max(axis=0) + points.min(axis=0)) / 2.0, np.ptp(points, axis=0) / 2.0 + _BESIDE
        if self.fingers:
            near = [s for s in own if (np.abs((data.site_xpos[s] - pos) @ mat - middle) < half).all()]
            own, toward, wrist = own if len(self.fingers) == 1 else near, mat @ middle, data.xanchor[self.joints[-1]]
            if toward @ (pos + toward - wrist) < 0.0:  # the hand's origin is at its fingertips
                toward = pos + toward - wrist
        site = next((s for word in _TCP_WORDS for s in own if word in self.mjm.site(s).name.lower()), None)
        if site is not None:
            toward = data.site_xpos[site] - pos if len(self.fingers) == 1 else toward
            along = self._along(data, data.site_xmat[site].reshape(3, 3), toward)
            return TcpConfig.model_validate({"site": self.mjm.site(site).name, **_rotation_to(along)})
        along = self._along(data, mat, toward)
        if self.fingers:
            tip = middle + along * (((points - middle) @ along).max() - _TIP)
            offset = [round(float(v), 4) + 0.0 for v in tip]
        return TcpConfig.model_validate({"body": self.mjm.body(body).name, "offset": offset, **_rotation_to(along)})

    def _along(self, data: mujoco.MjData, mat: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return the approach axis in a frame of the hand. If it is near an axis of this frame, return that axis.

        Args:
            data: The model in its start pose.
            mat: Orientation of the frame in the world, shape (3, 3).
            along: From the hand's origin to the middle of its fingers, or to the tool centre point [m], world frame. It
                is zero without fingers. If it is short, the last joint's axis gives the direction.
        """
        if np.linalg.norm(along) < _AT_ORIGIN:
            last = self.joints[-1]
            before = data.xpos[self.mjm.jnt_bodyid[self.joints[-3]]]
            along = data.xaxis[last] * (1.0 if data.xaxis[last] @ (data.xpos[self.palm[-1]] - before) >= 0.0 else -1.0)
        along = mat.T @ along / np.linalg.norm(along)
        nearest = np.eye(3)[np.argmax(np.abs(along))] * np.sign(along[np.argmax(np.abs(along))])
        # the middle of a single jaw is off to its side
        close = math.radians(2.0 * _CLOSE if len(self.fingers) == 1 else _CLOSE)
        return nearest if nearest @ along > math.cos(close) else along


def find_arms(mjm: mujoco.MjModel, roots: Iterable[int]) -> list[FoundArm]:
    """Return the arms below some bodies. Arms with fingers come first, then arms with more joints.

    At each body, the search follows the branch with the longest chain of joints if all other branches are much shorter.
    If the longest two branches have similar lengths, they are fingers if they are short, and otherwise the arms of a
    torso.
    """
    found = [arm for root in roots for arm in _arms_below(mjm, root, root, ())]
    return sorted(found, key=lambda arm: (not arm.fingers, -len(arm.joints)))


def _arms_below(mjm: mujoco.MjModel, base: int, body: int, joints: tuple[int, ...]) -> list[FoundArm]:
    own = np.flatnonzero((mjm.jnt_bodyid == body) & (mjm.jnt_type != mujoco.mjtJoint.mjJNT_FREE))
    joints = (*joints, *own.tolist())
    children = np.flatnonzero(mjm.body_parentid == body)
    depth = {int(c): _in_a_row(mjm, int(c)) for c in children if c and _in_a_row(mjm, int(c))}
    ranked = sorted(depth, key=lambda child: -depth[child])
    longest, second = [*(depth[child] for child in ranked), 0, 0][:2]
    if ranked and (second == 0 or (longest >= _LEAST_BRANCH and longest > 2 * second)):
        alone = second == 0 and longest < _LEAST_BRANCH and len(joints) >= _LEAST_JOINTS
        if not (alone and _ends_in_finger(mjm, ranked[0])):
            return _arms_below(mjm, base, ranked[0], joints)
    if len(joints) >= _LEAST_JOINTS and len({*mjm.jnt_bodyid[[*joints]]}) >= _LEAST_LINKS and longest <= _MOST_FINGER:
        fingers = tuple(b for child in ranked for b in subtree(mjm, child))
        hand = int(mjm.jnt_bodyid[joints[-1]]) if not fingers else body
        return [FoundArm(mjm, base, hand, joints, fingers)]
    return [arm for c in ranked if depth[c] > _MOST_FINGER for arm in _arms_below(mjm, base, c, joints)]


def _in_a_row(mjm: mujoco.MjModel, root: int) -> int:
    """Return the number of joints in the longest chain from `root` down to a descendant. Joints of `root` count too."""
    count = {int(mjm.body_parentid[root]): 0}
    for body in subtree(mjm, root):
        count[body] = count[int(mjm.body_parentid[body])] + int(mjm.body_jntnum[body])
    return max(count.values())


def _ends_in_finger(mjm: mujoco.MjModel, body: int) -> bool:
    """Return whether the only joint in a body and its descendants is a slide, or a hinge that a finger is named for."""
    own = [j for b in subtree(mjm, body) for j in range(mjm.njnt) if mjm.jnt_bodyid[j] == b]
    named = any(word in mjm.body(body).name.lower() for word in _FINGER_WORDS)
    return len(own) == 1 and (named or mjm.jnt_type[own[0]] == mujoco.mjtJoint.mjJNT_SLIDE)


def _points(mjm: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[int, ...]) -> np.ndarray:
    """Return the origins of bodies and the corners of their geoms' boxes, in the world frame [m], shape (n, 3).

    If a geom collides, those that only look do not count: they may be of other sizes on both sides.
    """
    own, solid = np.isin(mjm.geom_bodyid, bodies), (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    corners = geom_corners(mjm, data, np.flatnonzero(own & solid if (own & solid).any() else own))
    return np.concatenate([data.xpos[list(bodies)], corners])


def _rotation_to(along: np.ndarray) -> dict[str, float]:
    """Return the roll and pitch [degrees] that rotate the z axis to the direction `along`. Zero angles are omitted."""
    if math.degrees(math.acos(np.clip(along[2], -1.0, 1.0))) < _CLOSE:
        return {}
    x, y, z = along
    angles = {"roll": math.asin(np.clip(-y, -1.0, 1.0)), "pitch": math.atan2(x, z) if abs(y) <= 1.0 - 1e-9 else 0.0}
    return {word: turn for word, angle in angles.items() if (turn := round(math.degrees(angle), 2))}


@dataclass(frozen=True)
class FoundSupport:
    """A support with its level surfaces.

    Attributes:
        name: Name of the support in a scene file.
        body: Id of the support's body.
        surfaces: Level surfaces of the support, lowest first. May be empty.
        open_above: If True, no part of the body is above the surfaces, and objects stand 'on' the support. If False,
            the surfaces are covered, and objects stand 'in' the support.
    """

    name: str
    body: int
    surfaces: tuple[SupportSurface, ...]
    open_above: bool

    @property
    def area(self) -> float:
        """Total area of the surfaces [m^2]."""
        return sum(s.outline.area for s in self.surfaces)

    @property
    def extent(self) -> tuple[float, float]:
        """Edges of the rectangle around all surfaces, along the x and y axes of the body [m]."""
        x0, y0, x1, y1 = shapely.union_all([s.outline for s in self.surfaces]).bounds
        return x1 - x0, y1 - y0

    @property
    def is_endless(self) -> bool:
        """True if one of the surfaces is an infinite plane."""
        return any(s.is_endless for s in self.surfaces)


def geom_beneath(mjm: mujoco.MjModel, data: mujoco.MjData, root: int) -> int | None:
    """Return the geom that supports a body in the start pose: the first collision geom on a ray down, or None.

    The ray goes through the middle of the body and its descendants, and ignores their geoms. It starts at their top,
    because the body may be sunk into the geom. A geom that can move is ignored unless it reaches lower than the body,
    because it may stand on the body.

    Args:
        mjm: The model.
        data: The model in its start pose, after `mj_kinematics`.
        root: The body.
    """
    own = np.isin(mjm.geom_bodyid, subtree(mjm, root))
    low = high = data.xpos[root]
    if own.any():
        low, high = upright_box(mjm, data, np.flatnonzero(own))
    at, down, hit = np.array([*(low + high)[:2] / 2.0, high[2]]), np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    counts = ((mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)) & ~own
    seen = copy.copy(mjm)  # MuJoCo's rays pass through transparent geoms
    seen.geom_matid[:], seen.geom_rgba[:, 3] = -1, counts
    while mujoco.mj_ray(seen, data, at, down, None, 1, -1, hit, None) >= 0.0:
        if is_static(mjm)[mjm.geom_bodyid[hit[0]]] or upright_box(mjm, data, hit)[0][2] < low[2]:
            return int(hit[0])
        seen.geom_rgba[hit, 3] = 0.0
    return None


def support_beneath(
    mjm: mujoco.MjModel, data: mujoco.MjData, root: int, bodies: Mapping[str, int], pieces: Sequence[Piece]
) -> FoundSupport | None:
    """Return the support of a body in the start pose, or None. See `geom_beneath`, `named_support` and `support_of`."""
    geom = geom_beneath(mjm, data, root)
    named = None if geom is None else named_support(mjm, geom, bodies)
    return None if named is None else support_of(*named, pieces)


def supports_of(
    mjm: mujoco.MjModel, bodies: Mapping[str, int], robots: Iterable[int], pieces: Sequence[Piece]
) -> list[FoundSupport]:
    """Return the static bodies and geoms that have a name and a level surface, largest surface first.

    Bodies of robots are left out. If all surfaces of a body belong to one named geom, only this geom is returned.

    Args:
        mjm: The model.
        bodies: Root bodies of the scene's objects, by name.
        robots: Root bodies of robots.
        pieces: Convex pieces of the model.
    """
    found = [support_of(name, support, pieces) for name, support in static_supports(mjm, bodies).items()]
    found = [s for s in found if s.surfaces and mjm.body_rootid[s.body] not in set(robots)]
    geoms = {(s.body, round(s.area, 6)) for s in found if mujoco.mj_name2id(mjm, _GEOM, s.name) >= 0}
    kept = [s for s in found if mujoco.mj_name2id(mjm, _GEOM, s.name) >= 0 or (s.body, round(s.area, 6)) not in geoms]
    return sorted(kept, key=lambda s: -s.area)


def support_of(name: str, support: Support, pieces: Sequence[Piece]) -> FoundSupport:
    """Return a support with its level surfaces. Areas that its body covers from above only count if it has no others.

    Args:
        name: Name of the support in a scene file.
        support: The support.
        pieces: Convex pieces of the model.
    """
    own = [p for p in pieces if p.body == support.body]
    above = level_surfaces(support.body, own, open_above=True, geom=support.geom)
    found = above or level_surfaces(support.body, own, open_above=False, geom=support.geom)
    return FoundSupport(name, support.body, tuple(found), bool(above))


def named_support(mjm: mujoco.MjModel, geom: int, bodies: Mapping[str, int]) -> tuple[str, Support] | None:
    """Return the support that contains a geom, with the support's name in a scene file. None for an unnamed support.

    The support of a geom in an object is the object or its part. The support of a static geom is the geom if it has a
    name, and otherwise the geom's body. For other geoms, which may move, return None.

    Args:
        mjm: The model.
        geom: Id of the geom.
        bodies: Root bodies of the scene's objects, by name.
    """
    body = int(mjm.geom_bodyid[geom])
    owner = next((name for name, root in bodies.items() if body in subtree(mjm, root)), None)
    if owner is not None:
        root = mjm.body(bodies[owner]).name
        part = mjm.body(body).name.removeprefix(f"{root.rpartition('/')[0] or owner}/")
        name = owner if body == bodies[owner] else f"{owner}/{part}"
        return (name, Support(body, owner)) if body == bodies[owner] or part else None
    if not is_static(mjm)[body]:
        return None
    if mjm.geom(geom).name:
        return mjm.geom(geom).name, Support(body, None, geom)
    return (mjm.body(body).name, Support(body)) if body > 0 and mjm.body(body).name else None

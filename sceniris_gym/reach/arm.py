"""A serial arm: the joints of an MjModel between a base body and a TCP site.

The TCP's +z axis is the approach axis of the gripper. The fingers close along the TCP's +y axis.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from sceniris_gym.errors import ArmError, check_names

TCP = "tcp"
"""Name of the site at an asset's tool centre point."""
MAX_JOINTS = 8
"""Maximum number of joints of an arm. Device code keeps all of them in registers."""
HOME = "home"
"""Name of the keyframe with the start pose."""

_ANGLE_TOL = 1e-4  # [rad]
# A map requires the TCP to be on the last joint's axis and aligned with it, within these tolerances. A wrist rotation
# then moves the TCP by at most twice the tolerance, which is half of the tolerance of `ik`. The tolerances are not 0,
# because model files give angles with few digits.
_TCP_LENGTH_TOL = 2.5e-4  # [m]
_TCP_ANGLE_TOL = np.radians(0.12)


@dataclass(frozen=True, eq=False)
class SerialArm:
    """The kinematics of a serial arm in its base body's frame. Joints are ordered from base to tip.

    The TCP pose at joint positions q is the product of `link[i]` and the motion of joint i for all i, followed by
    `link[n]`. A hinge rotates by q - ref about its axis, and a slide moves by q - ref along its axis. The arm excludes
    joints beyond the TCP's body, joints on branches such as fingers, and joints that move the base. The pose of the
    base may differ between worlds.

    Attributes:
        name: Name of the base body.
        base_body, tcp_site: Ids of the base body and the TCP site in the model. If the named body has joints, they are
            the arm's first joints, and the base is the body's parent.
        joints: Names of the n joints, "" for a joint without a name.
        qposadr: Addresses of the joints in `qpos`, shape (n,).
        slide: True for slides, False for hinges, shape (n,), bool.
        lower, upper: Limits [rad, m], shape (n,). -inf and inf for a hinge without limits.
        ref: Joint positions (`qpos0`) at which the joints have not moved [rad, m], shape (n,).
        axis: Unit axes through the origin of each joint's frame, in that frame, shape (n, 3).
        link_pos, link_quat: Transforms from the frame after joint i - 1 (for i = 0, the base) to the frame of joint i.
            The last transform leads to the TCP. Shapes (n + 1, 3) [m] and (n + 1, 4), wxyz.
        home: Start positions of the joints, clipped to the limits [rad, m], shape (n,). They come from the keyframe
            'home', or from `ref` if the model has no such keyframe.
    """

    name: str
    base_body: int
    tcp_site: int
    joints: tuple[str, ...]
    qposadr: np.ndarray
    slide: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    ref: np.ndarray
    axis: np.ndarray
    link_pos: np.ndarray
    link_quat: np.ndarray
    home: np.ndarray

    @classmethod
    def from_model(cls, mjm: mujoco.MjModel, base: str, tcp: str = TCP) -> SerialArm:
        """Read the arm between the body `base` and the site `tcp`.

        Raises:
            UnknownNameError: The model has no such body or site.
            ArmError: The joints between the body and the site are not a serial chain of 1 to MAX_JOINTS hinges and
                slides, or a slide has no limits.
        """
        bodies = [mjm.body(i).name for i in range(mjm.nbody)]
        sites = [mjm.site(i).name for i in range(mjm.nsite)]
        check_names("body", [base], "arm", bodies)
        check_names("site", [tcp], f"arm '{base}'", sites)
        root, tcp_site = bodies.index(base), sites.index(tcp)
        ids, pos, quat = _chain(mjm, root, tcp_site)
        _check_joints(mjm, root, tcp, ids)
        adr = mjm.jnt_qposadr[ids]
        limited = mjm.jnt_limited[ids].astype(bool)[:, None]
        lower, upper = np.where(limited, mjm.jnt_range[ids], [-np.inf, np.inf]).T
        keys = [mjm.key(i).name for i in range(mjm.nkey)]
        home = mjm.key_qpos[keys.index(HOME)] if HOME in keys else mjm.qpos0
        return cls(
            name=base,
            base_body=fixed_base(mjm, root),
            tcp_site=tcp_site,
            joints=tuple(mjm.joint(i).name for i in ids),
            qposadr=adr.astype(int),
            slide=mjm.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_SLIDE),
            lower=lower,
            upper=upper,
            ref=mjm.qpos0[adr].copy(),
            axis=mjm.jnt_axis[ids].copy(),
            link_pos=pos,
            link_quat=quat,
            home=np.clip(home[adr], lower, upper),
        )

    @cached_property
    def hash(self) -> str:
        """Hash of the kinematics and limits, 16 hexadecimal digits. Names and the start pose do not change it.

        Values are rounded to 1e-6, so that an arm keeps its hash when its MJCF is attached to another model.
        """
        quat = self.link_quat * np.where(self.link_quat[:, :1] < 0.0, -1.0, 1.0)
        parts = [self.slide, self.lower, self.upper, self.ref, self.axis, self.link_pos, quat]
        rounded = [np.round(np.asarray(part, np.float64), 6) + 0.0 for part in parts]  # + 0.0 turns -0 into 0
        return hashlib.sha256(b"".join(part.tobytes() for part in rounded)).hexdigest()[:16]

    @property
    def tilt(self) -> float:
        """Angle [rad] from 0 to pi / 2 between the line of the first joint's axis and the base's z axis."""
        return _angle_to(rotate(self.axis[0], self.link_quat[0]), np.array([0.0, 0.0, 1.0]))

    @property
    def turns_tool(self) -> bool:
        """True if the arm has five joints or more, or if its last joint turns about the approach axis of the TCP."""
        along = rotate(np.eye(3)[2], self.link_quat[-1]) @ self.axis[-1]
        return len(self.joints) > 4 or bool(abs(along) > 0.5 and not self.slide[-1])

    @property
    def vertical(self) -> bool:
        """True if the first joint is a hinge with an axis parallel to the base's z axis."""
        return not self.slide[0] and self.tilt < _ANGLE_TOL

    @property
    def axis_xy(self) -> np.ndarray:
        """Intersection of the first joint's axis with the base's plane z = 0 [m], shape (2,). Requires `vertical`."""
        along = rotate(self.axis[0], self.link_quat[0])
        return (self.link_pos[0] - along * (self.link_pos[0, 2] / along[2]))[:2]

    @property
    def no_map(self) -> str | None:
        """Reason why the arm cannot have a map, or None.

        A map requires that the first joint rotates about the base's z axis, and the last joint about the TCP's z axis.
        """
        first, last = (f" '{name}'" if name else "" for name in (self.joints[0], self.joints[-1]))
        if self.slide[0]:
            return f"the first joint{first} is a slide, not a hinge about the vertical axis of '{self.name}'"
        if not self.vertical:
            return f"the first joint{first} is {np.degrees(self.tilt):.3g} degrees off the z axis of '{self.name}'"
        if self.slide[-1]:
            return f"the last joint{last} is a slide, not a hinge about the approach axis of the TCP"
        axis, pos = self.axis[-1], self.link_pos[-1]
        length = float(np.linalg.norm(pos - (pos @ axis) * axis))
        angle = _angle_to(rotate(np.array([0.0, 0.0, 1.0]), self.link_quat[-1]), axis)
        if length >= _TCP_LENGTH_TOL or angle >= _TCP_ANGLE_TOL:
            return (
                f"the TCP is {1000.0 * length:.3g} mm off the axis of the last joint{last}, "
                f"and its z axis is {np.degrees(angle):.3g} degrees off the direction of this axis"
            )
        return None

    def turns_freely(self, i: int) -> bool:
        """Return whether joint `i` can make a full rotation."""
        return bool(not self.slide[i] and self.upper[i] - self.lower[i] > 2.0 * np.pi - _ANGLE_TOL)


def fixed_base(mjm: mujoco.MjModel, root: int) -> int:
    """Return the body that carries an arm's first joint: the arm's root body, or its parent if the root has joints."""
    own = mjm.jnt_type[_joints_of(mjm, root)]
    return root if (own == mujoco.mjtJoint.mjJNT_FREE).all() else int(mjm.body_parentid[root])


def _chain(mjm: mujoco.MjModel, base: int, tcp: int) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Return the ids of the joints between a body and a site, and the transforms between the joint frames."""
    path = chain_up(mjm, int(mjm.site_bodyid[tcp]), base)
    if path[-1] != base:
        raise ArmError(
            f"arm '{mjm.body(base).name}' is not serial: the site '{mjm.site(tcp).name}' is not in the body's subtree. "
            f"Put the site on the hand, a body below '{mjm.body(base).name}'."
        )
    none = np.array([1.0, 0.0, 0.0, 0.0])
    ids, links = [], []
    pos, quat = np.zeros(3), none
    for body in reversed(path[: len(path) - (fixed_base(mjm, base) == base)]):
        pos, quat = compose(pos, quat, mjm.body_pos[body], mjm.body_quat[body])
        for joint in _joints_of(mjm, body):
            ids.append(joint)
            links.append(compose(pos, quat, mjm.jnt_pos[joint], none))
            pos, quat = -mjm.jnt_pos[joint], none
    links.append(compose(pos, quat, mjm.site_pos[tcp], mjm.site_quat[tcp]))
    return ids, np.array([link[0] for link in links]), np.array([link[1] for link in links])


def _check_joints(mjm: mujoco.MjModel, base_body: int, tcp: str, ids: list[int]) -> None:
    """Raise ArmError if joints are missing, too many, unsupported or coupled."""
    base, advice = mjm.body(base_body).name, _instead(mjm, base_body, tcp)
    if not ids:
        raise ArmError(
            f"arm '{base}': no joint is between this body and the site '{tcp}'. Put the site on a body that the arm's "
            "joints move."
        )
    if len(ids) > MAX_JOINTS:
        raise ArmError(
            f"arm '{base}' has {len(ids)} joints up to the site '{tcp}': it should have at most {MAX_JOINTS}. {advice}"
        )
    for i in ids:
        kind = mujoco.mjtJoint(mjm.jnt_type[i])
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            word = kind.name.removeprefix("mjJNT_").lower()
            raise ArmError(f"arm '{base}': {joint_label(mjm, i)} is a {word} joint. Use hinges and slides.")
        if kind == mujoco.mjtJoint.mjJNT_SLIDE and not mjm.jnt_limited[i]:
            raise ArmError(f"arm '{base}': {joint_label(mjm, i)} is a slide without limits. Give it a range. {advice}")
    for i in range(mjm.neq):
        if mjm.eq_active0[i] and _couples(mjm, i, fixed_base(mjm, base_body), ids):
            name = mjm.equality(i).name
            raise ArmError(
                f"arm '{base}' is not serial: the equality constraint {repr(name) if name else i} couples its joints. "
                "Remove the constraint, or let it couple only joints that do not move the TCP."
            )


def _instead(mjm: mujoco.MjModel, base: int, tcp: str) -> str:
    """Return the advice to name a body further up the arm, so that a mobile base or a torso keeps its start pose."""
    found = carrier_of(mjm, int(mjm.site_bodyid[mjm.site(tcp).id]), base)
    name = mjm.body(found).name if found else "BODY"
    robot = f"`robot: {{in_model: {name}}}`, a body without joints that carries the arm"
    return f"For an arm on a base that keeps its start pose, make its file the scene's `model`, and write {robot}."


def carrier_of(mjm: mujoco.MjModel, hand: int, base: int) -> int | None:
    """Return `base` if the joints from it up to a hand suit an arm, or else the body farthest from the hand that suits.

    An arm has at most MAX_JOINTS joints, and all its slides have limits. The other body has a name and no joints. None
    if there is no such body.
    """
    found, ids = None, []
    for body in chain_up(mjm, hand, base):
        if ids and not _joints_of(mjm, body) and mjm.body(body).name:
            found = body
        ids += _joints_of(mjm, body)
        is_open = (mjm.jnt_type[ids] == mujoco.mjtJoint.mjJNT_SLIDE) & (mjm.jnt_limited[ids] == 0)
        if len(ids) > MAX_JOINTS or is_open.any():
            return found
    return base


def _couples(mjm: mujoco.MjModel, eq: int, base: int, ids: list[int]) -> bool:
    """Return whether an equality constraint couples joints of the arm, or closes a loop through joints of the arm."""
    if mjm.eq_type[eq] == mujoco.mjtEq.mjEQ_JOINT:
        return mjm.eq_obj1id[eq] in ids or mjm.eq_obj2id[eq] in ids
    above = {_joints_above(mjm, body, base, ids) for body in joined_bodies(mjm, eq)}
    return None not in above and len(above) > 1


def joined_bodies(mjm: mujoco.MjModel, eq: int) -> tuple[int, ...]:
    """Return the two bodies of a weld or a connect, or an empty tuple for other equalities."""
    if mujoco.mjtEq(int(mjm.eq_type[eq])) not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return ()
    ends = [int(mjm.eq_obj1id[eq]), int(mjm.eq_obj2id[eq])]
    is_site = mjm.eq_objtype[eq] == mujoco.mjtObj.mjOBJ_SITE
    return tuple(mjm.site_bodyid[ends].tolist() if is_site else ends)


def _joints_above(mjm: mujoco.MjModel, body: int, base: int, ids: list[int]) -> int | None:
    """Return how many of the arm's joints move a body, or None if a free joint moves the body."""
    above = [joint for link in chain_up(mjm, body, base)[:-1] for joint in _joints_of(mjm, link)]
    free = (mjm.jnt_type[above] == mujoco.mjtJoint.mjJNT_FREE).any()
    return None if free else len({*ids}.intersection(above))


def chain_up(mjm: mujoco.MjModel, body: int, root: int = 0) -> list[int]:
    """Return the ids of a body and of the bodies above it, up to `root` or else to the world, in this order."""
    chain = [body]
    while chain[-1] not in (0, root):
        chain.append(int(mjm.body_parentid[chain[-1]]))
    return chain


def _joints_of(mjm: mujoco.MjModel, body: int) -> range:
    """Return the ids of a body's joints."""
    adr = int(mjm.body_jntadr[body])
    return range(adr, adr + int(mjm.body_jntnum[body]))


def joint_label(mjm: mujoco.MjModel, i: int) -> str:
    """Return a joint's name for errors. A joint without a name is described by its body."""
    name = mjm.joint(i).name
    return f"joint '{name}'" if name else f"the unnamed joint of body '{mjm.body(mjm.jnt_bodyid[i]).name}'"


def compose(pos: np.ndarray, quat: np.ndarray, then: np.ndarray, rot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the transform (pos, quat) followed by (then, rot), where (then, rot) is in the frame of (pos, quat)."""
    both = np.zeros(4)
    mujoco.mju_mulQuat(both, quat, rot)
    return pos + rotate(then, quat), both


def rotate(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Rotate a vector, shape (3,), by a wxyz quaternion."""
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, quat)
    return turned


def _angle_to(vector: np.ndarray, axis: np.ndarray) -> float:
    """Return the angle [rad] between the lines along two unit vectors."""
    return float(np.arctan2(np.linalg.norm(np.cross(vector, axis)), abs(vector @ axis)))

"""Checks the generator's claims that an arm reaches an object, and whether layouts fit their kinds of starts.

A claim of the tier `ik` or `clear` has joint positions, which MuJoCo C tests. A claim of another tier comes from the
arm's reachability map and has only a TCP pose. Inverse kinematics (chain.py) must find joint positions for this pose,
in a search from random joint positions. The joints are the chain from the robot's root body to the site of its TCP. The
hand is everything that the last of these joints carries. The positions of the finger joints also come from the claim.
For `clear`, only the hand may touch the object in the grasp, and the robot may touch no other object. Parts of the
robot may penetrate each other, but not deeper than in the start pose.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from sceniris_gym.audit.chain import POSITION, ROTATION, Chain
from sceniris_gym.audit.collisions import Conflict
from sceniris_gym.audit.contacts import Contact, deepest_contacts
from sceniris_gym.audit.geometry import Poses, Rows, frame, home_of, subtree
from sceniris_gym.audit.relations import Excess
from sceniris_gym.audit.scene import JudgedScene, Outlines
from sceniris_gym.audit.standing import Misplaced
from sceniris_gym.config.tier import Tier
from sceniris_gym.config.variants import with_variants
from sceniris_gym.scene.layout_table import LayoutTable

BACK = 0.08  # m, distance from the pre-grasp to the grasp along the approach
_LIMIT = 1e-6  # rad or m, claimed joints may exceed their limits by this
_DEEP = 1e-5  # m, a deeper contact is a collision
_OFF = 0.03  # m, greatest distance from the TCP of a grasp to the nearest box of the object's geoms
_STEP = 0.02  # rad or m, of the joints along a path
_STARTS, _STEPS = 64, 40  # of inverse kinematics


@dataclass(frozen=True)
class Claim:
    """Claim that a robot reaches an object. Arrays have one entry per row of a table.

    Attributes:
        name: The object.
        robot: The robot.
        rows: Mask of the rows that make this claim, shape (nrow,).
        tier: The definition of "reachable" that the claim uses.
        pose: TCP in the world frame, position [m] and orientation (w, x, y, z), shape (nrow, 7).
        qpos: Joint positions of the arm in the grasp [rad or m], from the base to the TCP, shape (nrow, njoint).
        pregrasp_qpos: Joint positions of the arm in the pre-grasp [rad or m], shape (nrow, njoint).
        path: Joint positions at the start and the vias of the path to the pre-grasp, shape (nrow, 3, njoint).
        fingers: Positions of the finger joints, shape (nrow, nfinger).
        finger_adr: Addresses of the finger joints in qpos, shape (nfinger,).
        pattern: The glob that selects grasps of the object, from the key `grasp` in the scene file. None for all.
        part: The name or glob of the joint, or of its body, if `grasp` is one of the object's `parts`. None otherwise.
    """

    name: str
    robot: str
    rows: np.ndarray
    tier: Tier
    pose: np.ndarray
    qpos: np.ndarray
    pregrasp_qpos: np.ndarray
    path: np.ndarray
    fingers: np.ndarray
    finger_adr: np.ndarray
    pattern: str | None = None
    part: str | None = None


class Unreached(Misplaced):
    """A claim about reach that is wrong: its row, the name of the object, and the cause."""


class ReachAudit:
    """Judges claims of reach.

    Args:
        mjm: The model.
        root: Id of the robot's root body.
        bodies: Object name -> root body id.
        tcp: Name of the site that is the robot's tool centre point.
        chain: The arm's kinematics for a robot with `in_scene: false`. Then `mjm` has only the robot's base, and joint
            positions are not judged. None for a robot in the scene.
    """

    def __init__(
        self, mjm: mujoco.MjModel, root: int, bodies: dict[str, int], tcp: str, chain: Chain | None = None
    ) -> None:
        self.mjm, self.data = mjm, mujoco.MjData(mjm)
        self.site = mjm.site(tcp).id if chain is None else -1
        self.chain = Chain(mjm, root, self.site) if chain is None else chain
        self.joints = self.chain.joints if chain is None else []
        self._base = root if chain is not None and chain.base else self.chain.base
        self.adr = mjm.jnt_qposadr[self.joints].astype(int)
        self._of = {name: subtree(mjm, body) for name, body in bodies.items()}
        self._robot = subtree(mjm, root)
        self._hand = subtree(mjm, int(mjm.jnt_bodyid[self.joints[-1]])) if chain is None else set()
        self._at_home = self._touching_at_home()

    def judge(self, table: LayoutTable, claims: Sequence[Claim]) -> list[Unreached]:
        """Check the claims about layouts and about this robot, and return the wrong claims."""
        found, asked = [], []
        for claim in claims:
            for row in np.flatnonzero(claim.rows).tolist():
                table.put(self.data, row)
                mujoco.mj_kinematics(self.mjm, self.data)
                cause = self._wrong(claim, row)
                if cause is not None:
                    found.append(Unreached(row, claim.name, cause))
                elif claim.tier.needs_map:
                    base = frame(np.hstack([self.data.xpos[self._base], self.data.xquat[self._base]]))
                    pose = np.linalg.inv(base) @ frame(claim.pose[row])
                    asked.append((Unreached(row, claim.name, "no joints found"), pose))
        if asked:
            poses = np.stack([pose for _, pose in asked])
            joints = self.chain.ik(poses, self.chain.random_joints(_STARTS), _STEPS)
            found += [unreached for (unreached, _), q in zip(asked, joints, strict=True) if np.isnan(q).any()]
        return found

    def _wrong(self, claim: Claim, row: int) -> str | None:
        """Return why a claim is wrong in the layout `row`, or None. The layout's state is in the attribute `data`.

        This method runs no inverse kinematics.
        """
        pose = claim.pose[row]
        if np.isnan(pose).any():
            return "no grasp"
        if self._distance(claim.name, pose[:3]) > _OFF:
            return "off the object"
        if not self._is_chosen(claim, frame(pose)):
            return "another grasp"
        if claim.tier.needs_map:
            return None
        self.data.qpos[claim.finger_adr] = claim.fingers[row]
        cause = self._wrong_joints(claim, claim.qpos[row], frame(pose))
        if cause is None and claim.tier >= Tier.CLEAR:
            before = frame(pose)
            before[:3, 3] -= BACK * before[:3, 2]
            cause = self._wrong_joints(claim, claim.pregrasp_qpos[row], before, grasping=False)
            cause = None if cause is None else f"pre-grasp: {cause}"
        if cause is None and claim.tier >= Tier.PATH:
            cause = self._wrong_path(claim, row)
        return cause

    def _wrong_path(self, claim: Claim, row: int) -> str | None:
        """Return why a path is wrong, or None. Along its straight pieces, joints are tested in steps of `_STEP`."""
        corners = np.vstack([claim.path[row], claim.pregrasp_qpos[row], claim.qpos[row]])
        if np.isnan(corners).any():
            return "no path"
        for i in range(4):
            for share in np.linspace(0.0, 1.0, 1 + int(np.abs(corners[i + 1] - corners[i]).max() / _STEP)):
                self.data.qpos[self.adr] = corners[i] + share * (corners[i + 1] - corners[i])
                mujoco.mj_kinematics(self.mjm, self.data)
                cause = self._hit(claim, grasping=i == 3)
                if cause is not None:
                    return f"path: {cause}"
        return None

    def _is_chosen(self, claim: Claim, pose: np.ndarray) -> bool:
        """Return whether a TCP pose (4, 4) is at one of the sites `grasp_*` that the claim's pattern or part selects.

        The pose may be turned by half a rotation about the approach axis. If no site is selected, return True.
        """
        bodies = self._of[claim.name] if claim.part is None else self._moved_with(claim.name, claim.part)
        sites = np.flatnonzero(np.isin(self.mjm.site_bodyid, list(bodies))).tolist()
        names = {s: self.mjm.site(s).name.rsplit("/", 1)[-1] for s in sites}
        own = {s: name for s, name in names.items() if name.startswith("grasp_")}
        chosen = [s for s, name in own.items() if any(fnmatchcase(n, claim.pattern or "*") for n in (name, name[6:]))]
        swapped = pose @ np.diag([-1.0, -1.0, 1.0, 1.0])
        return not chosen or any(self._meets(s, pose) or self._meets(s, swapped) for s in chosen)

    def _moved_with(self, name: str, part: str) -> set[int]:
        """Return the bodies that the first joint of an object that matches `part` moves."""
        mjm = self.mjm
        joints = np.flatnonzero(np.isin(mjm.jnt_bodyid, list(self._of[name]))).tolist()
        for named in (lambda j: mjm.joint(j).name, lambda j: mjm.body(mjm.jnt_bodyid[j]).name):
            for joint in joints:
                if fnmatchcase(f"/{named(joint)}", f"*/{part}"):
                    return subtree(mjm, int(mjm.jnt_bodyid[joint]))
        return set()

    def _wrong_joints(self, claim: Claim, qpos: np.ndarray, pose: np.ndarray, *, grasping: bool = True) -> str | None:
        mjm, data = self.mjm, self.data
        if np.isnan(qpos).any():
            return "no joints"
        if np.any(qpos < self.chain.lower - _LIMIT) or np.any(qpos > self.chain.upper + _LIMIT):
            return "limits"
        data.qpos[self.adr] = qpos
        mujoco.mj_kinematics(mjm, data)
        return self._hit(claim, grasping=grasping) if self._meets(self.site, pose) else "another pose"

    def _hit(self, claim: Claim, *, grasping: bool) -> str | None:
        """Return what the posed robot hits, or None. If `grasping`, its hand may touch the object of the claim."""
        mjm, data = self.mjm, self.data
        for geoms, (dist, _) in deepest_contacts(mjm, data).items():
            first, second = (int(mjm.geom_bodyid[g]) for g in geoms)
            mine = (first in self._robot) + (second in self._robot)
            if dist > -_DEEP or not mine:
                continue
            if mine == 2:
                if dist > self._at_home.get(geoms, 0.0) - _DEEP:
                    continue
                return "hits itself"
            if claim.tier < Tier.CLEAR:
                continue
            if not {first, second} & self._of[claim.name]:
                return "hits something"
            if not grasping or not {first, second} & self._hand:
                return "hits its target"
        return None

    def _touching_at_home(self) -> dict[tuple[int, int], float]:
        """Return pairs of the robot's geoms in contact in the start pose -> their least distance [m], at most 0."""
        alone = copy(self.mjm)  # collisions of objects are off, because all objects are at the origin at home
        others = ~np.isin(alone.geom_bodyid, list(self._robot))
        alone.geom_contype[others] = alone.geom_conaffinity[others] = 0
        contacts = deepest_contacts(alone, home_of(alone))
        return {geoms: min(dist, 0.0) for geoms, (dist, _) in contacts.items()}

    def _distance(self, name: str, point: np.ndarray) -> float:
        """Return the distance [m] from a point to the nearest box of an object's geoms, or 0 if there are no geoms."""
        geoms = np.isin(self.mjm.geom_bodyid, list(self._of[name]))
        center, half = np.split(self.mjm.geom_aabb[geoms], 2, axis=1)
        mat = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        local = np.einsum("nij,ni->nj", mat, point - self.data.geom_xpos[geoms])
        away = np.linalg.norm(np.maximum(np.abs(local - center) - half, 0.0), axis=1)
        return float(away.min()) if len(away) else 0.0

    def _meets(self, site: int, pose: np.ndarray) -> bool:
        """Return whether a site is within POSITION and ROTATION of a pose (4, 4) in the world."""
        away = np.linalg.norm(pose[:3, 3] - self.data.site_xpos[site])
        rotation = self.data.site_xmat[site].reshape(3, 3).T @ pose[:3, :3]
        return bool(away <= POSITION and np.trace(rotation) >= 1.0 + 2.0 * np.cos(ROTATION))


Sides = dict[tuple[int, str], set[int]]
"""(Row, object) -> geoms of a robot that touch it."""
_AT_MARKER = 1e-4  # m, greatest distance of an object from its marker, seen from above


class StartAudit:
    """Checks whether layouts fit their kinds of starts, and removes findings that a start permits.

    In a start, an arm may be at the grasp or pre-grasp of an object, and objects may be at markers.

    Args:
        scene: The scene.
        outlines: Outlines of the objects.
    """

    def __init__(self, scene: JudgedScene, outlines: Outlines) -> None:
        self.scene, self._outlines, variants = scene, outlines, scene.config.variants
        kinds = [(i, kind, kind.targets(variants)) for i, kind in enumerate(scene.config.start)]
        self._grasped = [(i, name) for i, kind, names in kinds if kind.robot == "grasp" for name in names]
        self._held = [(i, name) for i, kind, names in kinds if kind.is_held for name in names]
        self._placed = [(i, *pair) for i, kind, _ in kinds for pair in scene.config.markers(kind).items()]

    def grasped(self, table: LayoutTable) -> dict[str, np.ndarray]:
        """Return object -> mask of the rows where an arm holds it, shape (nrow,)."""
        return _rows(table, self._grasped)

    def moved(self, table: LayoutTable, there: Rows) -> dict[str, np.ndarray]:
        """Return object -> mask of the rows where the start decides where the object is, shape (nrow,).

        In these rows, the object's support, region, relations and orientation do not apply. `there` has masks of the
        rows in which each object is present.
        """
        found = _rows(table, self._held)
        for i, name, marker in self._placed:
            found[name] = found.get(name, False) | (table.start == i) & there[marker]
        return {name: rows & there[name] for name, rows in found.items()}

    def excuse(self, excess: Excess, moved: Rows) -> Excess:
        """Drop violations of objects that a start moves, and of objects whose relations refer to a moved object."""
        found = dict(excess)
        parts = self.scene.config.parts
        for key in excess:
            if key[0] in parts and key[1] != "present":
                names = {key[0], *with_variants(parts[key[0]].needs, self.scene.config.variants)}
                for rows in (moved[name] for name in names & moved.keys()):
                    found[key] = np.where(rows, np.nan, found[key])
        return found

    def excuses(self, table: LayoutTable, conflict: Conflict, grasped: Rows) -> bool:
        """Return whether a start permits a conflict.

        A start permits all conflicts between an arm and the object that this arm holds. In three cases, it permits
        distances below the clearance, but no contact: for an arm at a grasp or pre-grasp, for an object held in the
        air, and between an object at its marker and the support of this object.
        """
        number, owners, config = int(table.start[conflict.row]), set(conflict.owners), self.scene.config
        if number < 0:
            return False
        if self._holds(conflict.owners, conflict.row, grasped):
            return True
        kind = config.start[number]
        targets = kind.targets(config.variants)
        free = {*map(config.robot_for, targets), *(targets if kind.is_held else ())}
        supports = {name: config.parts[name].support for name in config.markers(kind)}
        carriers = {name: self.scene.carrier(support.parent).body for name, support in supports.items() if support}
        stands = any(owners == {name, self.scene.tree.owner[body]} for name, body in carriers.items())
        return conflict.distance > 0.0 and (stands or bool(free & owners))

    def _holds(self, owners: tuple[str, str], row: int, grasped: Rows) -> bool:
        """Return whether one of the two owners is a robot that holds the other owner in the layout `row`."""
        return any(
            one in grasped and grasped[one][row] and self.scene.config.robot_for(one) == other
            for one, other in (owners, owners[::-1])
        )

    def between(self, contacts: Iterable[Contact], grasped: Rows, sides: Sides) -> Iterator[Contact]:
        """Yield the contacts that starts do not permit, and collect the robot's geoms in contact with a held object.

        Args:
            contacts: The contacts.
            grasped: The result of the method `grasped`.
            sides: This method adds the robot's geoms in contact with a held object.
        """
        for contact in contacts:
            if not self._holds(contact.owners, contact.row, grasped):
                yield contact
                continue
            for geom, other in zip(contact.geoms, contact.owners[::-1], strict=True):
                if other in grasped:
                    sides.setdefault((contact.row, other), set()).add(geom)

    def check(self, table: LayoutTable, poses: Poses, there: Rows, sides: Sides) -> list[Misplaced]:
        """Return the objects that are not held, or not at their marker, although their start requires it.

        `there` has masks of the rows in which each object is present. `sides` has the geoms of the robot in contact
        with each held object, as collected by `between`.
        """
        found = [
            Misplaced(int(row), name, "start")
            for name, rows in self.grasped(table).items()
            for row in np.flatnonzero(rows & there[name])
            if len(sides.get((int(row), name), ())) < 2
        ]
        for i, name, marker in self._placed:
            own, other = (self._outlines.outline(n, poses).pivot[:, :2] for n in (name, marker))
            away = there[marker] & (np.linalg.norm(own - other, axis=1) > _AT_MARKER)
            found += [Misplaced(int(row), name, "start") for row in np.flatnonzero((table.start == i) & away)]
        return found


def _rows(table: LayoutTable, named: Sequence[tuple[int, str]]) -> dict[str, np.ndarray]:
    """Return object -> mask (nrow,) of the rows that have a kind of start to which `named` assigns the object.

    `named` has pairs: the index of a kind of start, and an object.
    """
    return {name: np.isin(table.start, [i for i, other in named if other == name]) for _, name in named}

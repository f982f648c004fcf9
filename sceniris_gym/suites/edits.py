"""Edits of nominal layouts: objects shifted or rotated on their supports, proven by the audit and stored as rows."""

from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.chain import Chain
from sceniris_gym.audit.geometry import frame
from sceniris_gym.audit.reach import BACK
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.scene_params import Param, scene_params
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import ReachTarget
from sceniris_gym.scene.layout_table import LayoutTable

STEPS = {"shift": 0.03, "turn": 18.0}
"""Shift [m] and rotation [degrees] of each object per grade, by axis."""
TRIES = 8
"""Number of random edits of a layout. If all of them fail a check, the layout is refused."""
_STARTS, _ITERATIONS = 16, 40  # of inverse kinematics


class _Movable(NamedTuple):
    """A free object: its slot, its address in qpos, the body and owner of its support, and the box of its region.

    An object without a box moves with its support, which is another free object.
    """

    slot: int
    adr: int
    support: int
    owner: str | None
    box: np.ndarray | None


class Edited(NamedTuple):
    """An edited layout.

    Attributes:
        row: The layout, as a table of one row.
        edits: {object: {"shift": [x, y]}} [m] in the frame of the support, or {object: {"turn": degrees}}.
        clipped: Whether an object reached an edge of its region, which shortened its shift.
    """

    row: LayoutTable
    edits: dict[str, dict[str, Any]]
    clipped: bool


class Editor:
    """Edits layouts of one scene.

    Args:
        compiled: The scene.

    Raises:
        ArgumentError: The scene has starts, or has no object that can be moved.
    """

    def __init__(self, compiled: CompiledScene) -> None:
        scene, config = compiled.scene, compiled.config
        if config.start or not all(robot.in_scene for robot in config.all_robots.values()):
            raise ArgumentError("--axes shift, turn: the scene should have no 'start', and no 'in_scene: false'.")
        self._compiled, self._auditor = compiled, Auditor(compiled.mjm, config, scene.bodies)
        self._data, self._chains, self._movable = mujoco.MjData(compiled.mjm), dict[str, Chain](), dict[str, _Movable]()
        params = scene_params(compiled)
        for name in compiled.placed:  # supports come first
            part, region = config.parts.get(name), params.get(f"{config.key(name)}.region")
            if part is None or part.kind != "free" or part.support is None:
                continue
            carrier, slot = self._auditor.scene.carrier(part.support.parent), compiled.slots.index(name)
            adr = int(compiled.mjm.jnt_qposadr[compiled.mjm.body_jntadr[scene.bodies[name]]])
            if carrier.owner in self._movable:
                self._movable[name] = _Movable(slot, adr, carrier.body, carrier.owner, None)
            elif isinstance(region, Param):
                box = region.default.reshape(2, 2).astype(float)
                self._movable[name] = _Movable(slot, adr, carrier.body, None, box)
        if not self._movable:
            raise ArgumentError("--axes shift, turn: the scene should have a free object whose region is a box.")

    def edit(self, row: LayoutTable, axis: str, grade: int, random: np.random.Generator) -> Edited | str:
        """Return an edit of a layout that passes all checks of the audit, or why the last edit failed.

        An edit that is not clipped is preferred. `axis` is a key of STEPS.
        """
        kept, why = None, ""
        for _ in range(TRIES):
            found = self._moved(row, axis, grade, random)
            why = self._wrong(found.row)
            if not why and not found.clipped:
                return found
            kept = found if not why and kept is None else kept
        return why if kept is None else kept

    def _moved(self, row: LayoutTable, axis: str, grade: int, random: np.random.Generator) -> Edited:
        row.put(self._data, 0)
        mujoco.mj_kinematics(self._compiled.mjm, self._data)
        qpos, edits, clipped, moves = self._data.qpos.copy(), {}, False, dict[str, np.ndarray]()
        for name, one in self._movable.items():
            angle, sign, by = random.uniform(0.0, 2.0 * np.pi), random.choice((-1.0, 1.0)), STEPS[axis] * grade
            if not row.present[0, one.slot]:
                continue
            old, axes = frame(qpos[one.adr : one.adr + 7]), self._data.xmat[one.support].reshape(3, 3)
            new, at = old.copy(), (axes.T @ (old[:3, 3] - self._data.xpos[one.support]))[:2]
            if one.box is None:
                new = moves[str(one.owner)] @ old
            elif axis == "turn":
                new[:3, :3] = Rotation.from_rotvec(np.radians(sign * by) * axes[:, 2]).as_matrix() @ old[:3, :3]
                edits[name] = {axis: float(sign * by)}
            else:
                wanted = at + by * np.array([np.cos(angle), np.sin(angle)])
                to = np.clip(wanted, np.minimum(one.box[0], at), np.maximum(one.box[1], at))
                new[:3, 3] += axes[:, :2] @ (to - at)
                clipped, edits[name] = clipped | bool((to != wanted).any()), {axis: (to - at).tolist()}
            moves[name], qpos[one.adr : one.adr + 3] = new @ np.linalg.inv(old), new[:3, 3]
            if axis == "turn":
                mujoco.mju_mat2Quat(qpos[one.adr + 3 : one.adr + 7], new[:3, :3].ravel())
        moved = replace(row, qpos=qpos[None].astype(np.float32))
        return Edited(self._regrasped(moved, moves), edits, clipped)

    def _regrasped(self, row: LayoutTable, moves: dict[str, np.ndarray]) -> LayoutTable:
        """Return the row with grasps that moved with their objects. The arm's joints are solved again."""
        reaching = self._compiled.reaching
        columns = {n: getattr(row, n).copy() for n in ("grasp_pose", "grasp_qpos", "pregrasp_qpos", "path")}
        for k, target in enumerate(() if reaching is None else reaching.targets):
            grasp = columns["grasp_pose"][0, k]
            if target.name not in moves or np.isnan(grasp).any():
                continue
            pose, quat = moves[target.name] @ frame(grasp.astype(float)), np.zeros(4)
            mujoco.mju_mat2Quat(quat, pose[:3, :3].ravel())
            grasp[:], columns["path"][0, k] = [*pose[:3, 3], *quat], np.nan
            for name, back in (("grasp_qpos", 0.0), ("pregrasp_qpos", BACK)):
                if not np.isnan(columns[name][0, k, 0]):
                    pose[:3, 3] -= back * pose[:3, 2]
                    found = self._joints(target, pose, columns[name][0, k])
                    columns[name][0, k, : len(found)] = found
        return replace(row, **columns)

    def _joints(self, target: ReachTarget, pose: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return joints of the arm that reach a TCP pose, from a start or random joints. NaN if the search fails."""
        compiled = self._compiled
        robot = compiled.reaching.arm_of(target).robot  # pyrefly: ignore[missing-attribute]
        if robot not in self._chains:
            site = compiled.mjm.site(compiled.scene.tcps[robot]).id
            self._chains[robot] = Chain(compiled.mjm, compiled.scene.bodies[robot], site)
        chain = self._chains[robot]
        base = frame(np.hstack([self._data.xpos[chain.base], self._data.xquat[chain.base]]))
        starts = np.vstack([start[: len(chain.joints)], chain.random_joints(_STARTS)])
        return chain.ik((np.linalg.inv(base) @ pose)[None], starts, _ITERATIONS)[0]

    def _wrong(self, row: LayoutTable) -> str:
        """Return the first finding of the audit, or ""."""
        report, claims = self._auditor.judge(row), reach_claims(self._compiled, row)
        found = [f"{' and '.join(map(str, c.owners))} collide" for c in report.conflicts]
        found += [f"{m.name}: {m.cause}" for m in report.misplaced]
        found += [f"{k.name}: {k.word}" for k in report.kept if k.broken]
        found = found or [f"{u.name}: {u.cause}" for u in judge_reach(self._compiled, row, claims)]
        return found[0] if found else ""

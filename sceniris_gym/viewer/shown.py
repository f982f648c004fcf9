"""One world that the viewer shows: its layout, the arm's poses in it, and its simulation."""

from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from sceniris_gym.audit.physics import hold
from sceniris_gym.geometry.rotations import matrix, pose_matrix, quaternion
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.plan import PlacedObject
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import random_joints, solve
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.overview import upright_box
from sceniris_gym.scene.parking import is_parked
from sceniris_gym.viewer.sketch import BLUE, Sketch

_LONGEST = 0.1  # s of physics between two pictures: a slow machine loses real time, but the page does not freeze


@dataclass(frozen=True)
class ShownWorld:
    """One world that the viewer shows.

    Attributes:
        compiled: The scene.
        table: The layout, one row.
        unplaced: Objects without a place yet, which are not drawn.
        stands: Two arrays with a row for each of `Plan.columns`: pivots [m] with headings [rad], and bounds [m], shape
            (ncolumn, 4) each. The generator of the layout computed them. If None, they are computed from the layout.
    """

    compiled: CompiledScene
    table: LayoutTable
    unplaced: frozenset[str] = frozenset()
    stands: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def data(self) -> mujoco.MjData:
        """MjData in the state of the layout, after kinematics."""
        data = mujoco.MjData(self.compiled.mjm)
        self.table.put(data, 0)
        mujoco.mj_kinematics(self.compiled.mjm, data)
        mujoco.mj_comPos(self.compiled.mjm, data)
        return data

    @cached_property
    def absent(self) -> list[str]:
        """Names of the objects that are absent from this layout: members of groups that were not drawn."""
        return [name for name in self.compiled.object_names if not self.is_present(name)]

    def is_present(self, name: str) -> bool:
        """Return True if an object is present in this layout."""
        return bool(self.table.present[0, self.compiled.slots.index(self.own(name))])

    def own(self, name: str) -> str:
        """Return the present variant of an object, or the name of an object without variants."""
        members = self.compiled.config.variants.get(name, (name,))
        return members[int(self.table.present[0, list(map(self.compiled.slots.index, members))].argmax())]

    def is_shown(self, name: str) -> bool:
        """Return True if an object is present and has a place."""
        return self.is_present(name) and self.own(name) not in self.unplaced

    def standing(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return an object's pivot [m] with heading [rad], and its bounds [m], shape (4,) each. Relations use both."""
        plan, name = self.compiled.plan, self.own(name)
        column = plan.columns.index(self.compiled.config.owners.get(name, name))
        if self.stands is not None:
            return self.stands[0][column], self.stands[1][column]
        poses = self.placed(name).stable_poses if name in self.compiled.placed else []
        if not poses:
            return plan.pivot_pose[column], plan.bounds[column]
        root = self.compiled.scene.bodies[name]
        mat = self.data.xmat[root].reshape(3, 3)
        rotations = [mat @ matrix(pose.quat).T for pose in poses]
        # The right stable pose differs from the state only by a rotation about the vertical.
        best = int(np.argmax([rotation[2, 2] for rotation in rotations]))
        heading = np.arctan2(rotations[best][1, 0], rotations[best][0, 0])
        return np.array([*self.data.xpos[root] + mat @ poses[best].pivot, heading]), poses[best].bounds

    def box(self, name: str, root_alone: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the low and the high corner [m] of the box along the world's axes around an object, shape (3,) each.

        With `root_alone`, the box is only around the root body of the object.
        """
        mjm, data, name = self.compiled.mjm, self.data, self.own(name)
        bodies = [self.compiled.scene.bodies[name]] if root_alone else self.compiled.scene.subtree(name)
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, bodies))
        if not len(geoms):
            at = data.xpos[self.compiled.scene.bodies[name]]
            return at, at
        return upright_box(mjm, data, geoms)

    def from_body(self, body: int, points: np.ndarray) -> np.ndarray:
        """Transform points (..., 3) [m] from a body's frame to the world's frame."""
        return points @ self.data.xmat[body].reshape(3, 3).T + self.data.xpos[body]

    def placed(self, name: str) -> PlacedObject:
        """Return the entry of a placed object in `Plan.objects`."""
        return self.compiled.plan.objects[self.compiled.placed.index(name)]

    @property
    def placed_names(self) -> list[str]:
        """Objects and robots that layouts place and that this world shows, in the order of the scene file."""
        parts = self.compiled.config.parts
        return [name for name in parts if parts[name].is_placed and self.is_shown(name)]

    def hidden_bodies(self, with_absent: bool = True) -> list[int]:
        """Return the bodies of objects that have no place yet and, with `with_absent`, of absent objects."""
        names = [*self.unplaced, *(self.absent if with_absent else [])]
        return [body for name in names for body in self.compiled.scene.subtree(name)]

    def parked_offsets(self, low: np.ndarray) -> dict[int, np.ndarray]:
        """Return a mapping: body -> offset [m]. The offsets move absent objects into a row in front of the scene.

        `low` is the low corner of the scene's bounds [m], shape (3,).
        """
        offsets = {}
        for i, name in enumerate(self.absent):
            at = np.array([low[0] + 0.15 + 0.3 * i, low[1] - 0.2, low[2]])
            root = self.data.xpos[self.compiled.scene.bodies[name]].copy()
            root[2] = 0.0 if is_parked(root) else root[2]
            offsets |= dict.fromkeys(self.compiled.scene.subtree(name), at - root)
        return offsets


class Player:
    """Simulates one world with MuJoCo C, starting in its layout.

    Args:
        compiled: The scene.
        table: The layout, one row.

    Attributes:
        data: MjData in the current state.
        running: False while the simulation is paused.
    """

    def __init__(self, compiled: CompiledScene, table: LayoutTable) -> None:
        self.mjm, self.table = compiled.mjm, table
        self.data = mujoco.MjData(compiled.mjm)
        self._closed = _closed_fingers(compiled, table)
        self.running = False
        self.reset()

    def reset(self) -> None:
        """Return to the layout. Set controls that hold the joints, and that close the fingers around a held object."""
        mujoco.mj_resetData(self.mjm, self.data)
        self.table.put(self.data, 0)
        adr, closed = self._closed
        self.data.qpos[adr] = closed
        hold(self.mjm, self.data)
        self.table.put(self.data, 0)
        mujoco.mj_forward(self.mjm, self.data)
        self._debt = 0.0

    def advance(self, seconds: float) -> bool:
        """Simulate about `seconds` [s]. Return True if at least one step was taken."""
        if not self.running:
            return False
        self._debt = min(self._debt + seconds, _LONGEST)
        steps = int(self._debt / self.mjm.opt.timestep)
        self._debt -= steps * self.mjm.opt.timestep
        for _ in range(steps):
            mujoco.mj_step(self.mjm, self.data)
        return steps > 0

    def step(self) -> None:
        """Take a single step of physics."""
        mujoco.mj_step(self.mjm, self.data)


def target_ranges(mjm: mujoco.MjModel) -> list[tuple[str, float, float]]:
    """Return the name, the least and the greatest control of each actuator, for its slider.

    If an actuator has no control limits, its slider has the limits of its joint. If the joint has no limits either, the
    slider goes from -1 to 1.
    """
    ranges = []
    for i in range(mjm.nu):
        low, high, joint = -1.0, 1.0, int(mjm.actuator_trnid[i, 0])
        if mjm.actuator_ctrllimited[i]:
            low, high = mjm.actuator_ctrlrange[i]
        elif mjm.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT and mjm.jnt_limited[joint]:
            low, high = mjm.jnt_range[joint]
        ranges.append((mjm.actuator(i).name or f"actuator {i}", float(low), float(high)))
    return ranges


def _closed_fingers(compiled: CompiledScene, table: LayoutTable) -> tuple[np.ndarray, np.ndarray]:
    """Return the qpos addresses of fingers that hold an object at the start of a layout, and their closed positions.

    If no object is held at the start, both arrays are empty.
    """
    if compiled.config.start and compiled.reaching is not None:
        kind = compiled.config.start[table.start[0]]
        for name in kind.targets(compiled.config.variants) if kind.robot == "grasp" else ():
            if table.present[0, compiled.slots.index(name)]:
                target = compiled.reaching.targets[compiled.reaching.names.index(name)]
                adr, closed = compiled.reaching.arm_of(target).gripper.poses(np.zeros(1))
                return adr, closed[0]
    return np.zeros(0, int), np.zeros(0)


START, GRASP, PREGRASP = "start", "grasp", "pre-grasp"
_RESTARTS = 64


def sketch_grasps(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the TCP's axes in the grasp of each reach target, or only of the target `only`. The approach axis is blue.

    An arrow goes from the pre-grasp to the grasp.
    """
    sketch, reaching = Sketch(), world.compiled.reaching
    for k, target in enumerate(() if reaching is None else reaching.targets):
        pose = grasp_pose(world, k)
        if pose is None or only not in (None, target.name):
            continue
        pos, quat = pose
        before = pos - PREGRASP_DISTANCE * matrix(quat)[:, 2]
        sketch.axes.append((pos, quat))
        sketch.arrows.append((np.stack([before, pos]), BLUE))
        name = target.grasp_set.grasps[world.table.grasp[0, k]].name
        sketch.labels.append((f"{target.name}: grasp '{name}'", before))
    return sketch


def grasp_pose(world: ShownWorld, k: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the TCP's position [m] and orientation (wxyz) in the grasp of reach target `k`.

    Return None if the target has no grasp.
    """
    if world.table.grasp.shape[1] <= k or world.table.grasp[0, k] < 0:
        return None
    pose = world.table.grasp_pose[0, k].astype(float)
    return pose[:3], pose[3:]


def poses_of_arm(world: ShownWorld) -> list[str]:
    """Return the names of the poses that `with_arm` accepts: "start", "grasp of OBJECT" and "pre-grasp of OBJECT".

    An object is listed if it is a reach target with a grasp, and the target's arm is part of the simulated model.
    """
    reaching = world.compiled.reaching
    if reaching is None:
        return [START]
    present = [target for k, target in enumerate(reaching.targets) if grasp_pose(world, k) is not None]
    names = [target.name for target in present if reaching.arm_of(target).robot not in world.compiled.scene.apart]
    return [START, *(f"{step} of {name}" for name in names for step in (PREGRASP, GRASP))]


def with_arm(world: ShownWorld, pose: str) -> LayoutTable | None:
    """Return the layout with the arm in a pose from `poses_of_arm`, or None if inverse kinematics finds no solution.

    The layout stores the arm's joint positions in each grasp and pre-grasp. If reachability was only tested with the
    arm's map, the layout has no such positions, and inverse kinematics computes them.
    """
    reaching = world.compiled.reaching
    if pose == START or reaching is None:
        return world.table
    step, _, name = pose.partition(" of ")
    k = reaching.names.index(name)
    one = reaching.arm_of(reaching.targets[k])
    known = world.table.grasp_qpos if step == GRASP else world.table.pregrasp_qpos
    joints = known[0, k] if not np.isnan(known[0, k]).any() else _solved(world, one.arm, k, step)
    if joints is None:
        return None
    qpos = world.table.qpos.copy()
    qpos[0, one.arm.qposadr] = joints[: len(one.arm.joints)]
    fingers, values = one.gripper.poses(np.array([1.0]))
    qpos[0, fingers] = values[0]
    return replace(world.table, qpos=qpos)


def _solved(world: ShownWorld, arm: SerialArm, k: int, step: str) -> np.ndarray | None:
    pos, quat = np.split(world.table.grasp_pose[0, k].astype(float), [3])
    back = 0.0 if step == GRASP else PREGRASP_DISTANCE
    base = pose_matrix(world.data.xpos[arm.base_body], world.data.xquat[arm.base_body])
    local = np.linalg.inv(base) @ pose_matrix(pos - back * matrix(quat)[:, 2], quat)
    starts = np.concatenate([world.data.qpos[None, arm.qposadr], random_joints(arm, _RESTARTS)])
    joints, solved = solve(arm, np.array([[*local[:3, 3], *quaternion(local[:3, :3])]]), starts=starts)
    return joints[0] if solved[0] else None

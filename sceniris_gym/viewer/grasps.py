"""The layer of grasps: the accepted grasp of each reachable object, and the arm in these grasps."""

from dataclasses import replace

import mujoco
import numpy as np

from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import random_joints, solve
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import BLUE, Sketch

START, GRASP, PREGRASP = "start", "grasp", "pre-grasp"
_RESTARTS = 64


def sketch_grasps(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw the axes of each reach target's grasp, and an arrow from the pre-grasp. The approach axis is blue."""
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
    """Return the TCP's pose in the grasp of reach target `k`, [m] and wxyz, None if the target is absent."""
    if world.table.grasp.shape[1] <= k or world.table.grasp[0, k] < 0:
        return None
    pose = world.table.grasp_pose[0, k].astype(float)
    return pose[:3], pose[3:]


def poses_of_arm(world: ShownWorld) -> list[str]:
    """Return the poses for `with_arm`: start, and grasp and pre-grasp of each target that the model's arms reach."""
    reaching = world.compiled.reaching
    if reaching is None:
        return [START]
    present = [target for k, target in enumerate(reaching.targets) if grasp_pose(world, k) is not None]
    names = [target.name for target in present if reaching.arm_of(target).robot not in world.compiled.scene.apart]
    return [START, *(f"{step} of {name}" for name in names for step in (PREGRASP, GRASP))]


def with_arm(world: ShownWorld, pose: str) -> LayoutTable | None:
    """Return the layout with the arm in a pose of `poses_of_arm`, None if inverse kinematics fail.

    The layout stores the arm's joint positions in its grasps. If the layout was only tested with the arm's map, inverse
    kinematics compute these positions.
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
    base = world.data.xpos[arm.base_body], world.data.xquat[arm.base_body]
    inverse, local = (np.empty(3), np.empty(4)), (np.empty(3), np.empty(4))
    mujoco.mju_negPose(*inverse, *base)
    mujoco.mju_mulPose(*local, *inverse, pos - back * matrix(quat)[:, 2], quat)
    starts = np.concatenate([world.data.qpos[None, arm.qposadr], random_joints(arm, _RESTARTS)])
    joints, solved = solve(arm, np.concatenate(local)[None], starts=starts)
    return joints[0] if solved[0] else None

"""The layer of grasps: those that layouts were accepted for, and the arm in them."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE
from sceniris_gym.program.reach import ReachTarget
from sceniris_gym.reach.solve import random_joints, solve
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import BLUE, Sketch

START, GRASP, PREGRASP = "start", "grasp", "pre-grasp"
_RESTARTS = 64


def sketch_grasps(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw for each reach target the axes of its grasp (blue: the approach), and an arrow from the pre-grasp to it."""
    sketch = Sketch()
    for k, target in enumerate(_targets(world)):
        pose = grasp_pose(world, k)
        if pose is None or only not in (None, target.name):
            continue
        pos, quat = pose
        sketch.axes.append((pos, quat))
        sketch.arrows.append((np.stack([pos - PREGRASP_DISTANCE * _approach(quat), pos]), BLUE))
        name = target.grasp_set.grasps[world.table.grasp[0, k]].name
        sketch.words.append((f"{target.name}: grasp '{name}'", pos - PREGRASP_DISTANCE * _approach(quat)))
    return sketch


def grasp_pose(world: ShownWorld, k: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return where the TCP is in the grasp of reach target `k`: position [m], orientation; None where it is absent."""
    if world.table.grasp.shape[1] <= k or world.table.grasp[0, k] < 0:
        return None
    grasp = _targets(world)[k].grasp_set.grasps[world.table.grasp[0, k]]
    pos, quat = np.empty(3), np.empty(4)
    body = world.data.xpos[grasp.body], world.data.xquat[grasp.body]
    mujoco.mju_mulPose(pos, quat, *body, grasp.pos, grasp.quat)
    return pos, quat


def poses_of_arm(world: ShownWorld) -> list[str]:
    """Return what the arm can jump into, as `with_arm` takes it: the start, and grasp and pre-grasp of each target."""
    names = [t.name for k, t in enumerate(_targets(world)) if grasp_pose(world, k) is not None and _is_there(world, k)]
    return [START, *(f"{step} of {name}" for name in names for step in (PREGRASP, GRASP))]


def with_arm(world: ShownWorld, pose: str) -> LayoutTable | None:
    """Return the layout with the arm in a pose of `poses_of_arm`; None where no joints lead to it.

    Joints are those that the layout was accepted with. Where its arm's map alone decided, they are solved for.
    """
    if pose == START or world.compiled.reaching is None:
        return world.table
    step, _, name = pose.partition(" of ")
    k = [t.name for t in _targets(world)].index(name)
    known = world.table.grasp_qpos if step == GRASP else world.table.pregrasp_qpos
    joints = known[0, k] if not np.isnan(known[0, k]).any() else _solved(world, k, step)
    if joints is None:
        return None
    qpos = world.table.qpos.copy()
    one = world.compiled.reaching.arm_of(_targets(world)[k])
    qpos[0, one.arm.qposadr] = joints[: len(one.arm.joints)]
    fingers, values = one.gripper.poses(np.array([1.0]))
    qpos[0, fingers] = values[0]
    return replace(world.table, qpos=qpos)


def _solved(world: ShownWorld, k: int, step: str) -> np.ndarray | None:
    reaching, pose = world.compiled.reaching, grasp_pose(world, k)
    assert reaching is not None
    assert pose is not None
    arm, (pos, quat) = reaching.arm_of(reaching.targets[k]).arm, pose
    back = 0.0 if step == GRASP else PREGRASP_DISTANCE
    base = world.data.xpos[arm.base_body], world.data.xquat[arm.base_body]
    inverse, local = (np.empty(3), np.empty(4)), (np.empty(3), np.empty(4))
    mujoco.mju_negPose(*inverse, *base)
    mujoco.mju_mulPose(*local, *inverse, pos - back * _approach(quat), quat)
    starts = np.concatenate([world.data.qpos[None, arm.qposadr], random_joints(arm, _RESTARTS)])
    joints, solved = solve(arm, np.concatenate(local)[None], starts=starts)
    return joints[0] if solved[0] else None


def _is_there(world: ShownWorld, k: int) -> bool:
    """Whether the arm that is to reach a target is in the scene."""
    reaching = world.compiled.reaching
    return reaching is not None and reaching.arm_of(reaching.targets[k]).robot not in world.compiled.scene.apart


def _targets(world: ShownWorld) -> tuple[ReachTarget, ...]:
    return () if world.compiled.reaching is None else world.compiled.reaching.targets


def _approach(quat: np.ndarray) -> np.ndarray:
    axis = np.empty(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), quat)
    return axis

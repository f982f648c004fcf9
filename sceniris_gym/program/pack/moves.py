"""Bounds of the motion of a robot's bodies while the joints of its arm move."""

import mujoco
import numpy as np

from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import ReachingArm
from sceniris_gym.reach.arm import chain_up


def moves_of(plan: Plan, one: ReachingArm) -> np.ndarray:
    """Return bounds of motions in the model of a scene, shape (nbody, njoint).

    The bound for a body and a joint of the arm is how far any point of the body's geoms moves at most, in any pose of
    the other joints, if the joint turns by 1 rad or slides by 1 m. For a hinge this is the greatest distance of a point
    from the joint's anchor. It is 0 if the joint does not move the body.
    """
    mjm = plan.scene.mjm
    joints = [int(np.flatnonzero(mjm.jnt_qposadr == adr)[0]) for adr in one.arm.qposadr]
    radius, slides = np.zeros(mjm.nbody), mjm.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    np.maximum.at(radius, mjm.geom_bodyid, np.linalg.norm(mjm.geom_pos, axis=1) + mjm.geom_rbound)
    furthest = np.where(slides, _furthest(plan, one), 0.0)
    lengths = np.linalg.norm(mjm.jnt_pos, axis=1), furthest
    anchor, travel = (np.bincount(mjm.jnt_bodyid, length, mjm.nbody) for length in lengths)
    found = np.zeros((mjm.nbody, len(joints)))
    for body in plan.scene.moving(one.robot):
        reached = radius[body]
        for link in chain_up(mjm, body):
            for i, joint in enumerate(joints):
                if mjm.jnt_bodyid[joint] == link:
                    found[body, i] = 1.0 if slides[joint] else reached + anchor[link]
            reached += np.linalg.norm(mjm.body_pos[link]) + 2.0 * anchor[link] + travel[link]
    return found


def _furthest(plan: Plan, one: ReachingArm) -> np.ndarray:
    """Return how far each joint is at most from `qpos0` [m or rad], shape (njnt,), if it is a slide of the robot.

    A slide without limits is in its start pose, drawn, or moved by the gripper.
    """
    mjm = plan.scene.mjm
    ends = np.tile(plan.scene.home_qpos, (2, 1))
    for adr, span in (pair for o in plan.objects if o.name == one.robot for pair in o.spans.items()):
        ends[:, adr] = span
    adr, qpos = one.gripper.poses(np.linspace(0.0, 1.0, 17))
    ends[:, adr] = qpos.min(axis=0), qpos.max(axis=0)
    ends = np.where(mjm.jnt_limited.astype(bool), mjm.jnt_range.T, ends[:, mjm.jnt_qposadr])
    return np.abs(ends - mjm.qpos0[mjm.jnt_qposadr]).max(axis=0)

"""Bounds of the motion of a robot's bodies while the joints of its arm move."""

import mujoco
import numpy as np

from sceniris_gym.reach.arm import SerialArm, chain_up
from sceniris_gym.scene.model import SceneModel


def moves_of(scene: SceneModel, robot: str, arm: SerialArm) -> np.ndarray:
    """Return bounds of motions in the model of a scene, shape (nbody, njoint).

    The bound for a body and a joint of the arm is how far any point of the body's geoms moves at most, in any pose of
    the other joints, if the joint turns by 1 rad or slides by 1 m. For a hinge this is the greatest distance of a point
    from the joint's anchor. It is 0 if the joint does not move the body.
    """
    mjm = scene.mjm
    joints = [int(np.flatnonzero(mjm.jnt_qposadr == adr)[0]) for adr in arm.qposadr]
    radius, slides = np.zeros(mjm.nbody), mjm.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    np.maximum.at(radius, mjm.geom_bodyid, np.linalg.norm(mjm.geom_pos, axis=1) + mjm.geom_rbound)
    furthest = np.where(slides, np.abs(mjm.jnt_range - mjm.qpos0[mjm.jnt_qposadr, None]).max(axis=1), 0.0)
    lengths = np.linalg.norm(mjm.jnt_pos, axis=1), furthest
    anchor, travel = (np.bincount(mjm.jnt_bodyid, length, mjm.nbody) for length in lengths)
    found = np.zeros((mjm.nbody, len(joints)))
    for body in scene.moving(robot):
        reached = radius[body]
        for link in chain_up(mjm, body):
            for i, joint in enumerate(joints):
                if mjm.jnt_bodyid[joint] == link:
                    found[body, i] = 1.0 if slides[joint] else reached + anchor[link]
            reached += np.linalg.norm(mjm.body_pos[link]) + 2.0 * anchor[link] + travel[link]
    return found

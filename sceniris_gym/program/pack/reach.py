"""The reach targets of a plan as the fields of `device_reach.Reach`, one for each arm."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.geometry.ragged import addressed, columns
from sceniris_gym.geometry.rotations import product, quaternion
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_reach import BASE, UNASKED, Reach
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import ReachingArm
from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.solve import arm_view
from sceniris_gym.scene.couplings import coupling_arrays
from sceniris_gym.scene.model import SceneModel


def fill_views(plan: Plan, arm_lists: Mapping[str, np.ndarray], device: str) -> None:
    """Fill the views of all arms that are to reach something.

    Args:
        plan: The plan of the scene.
        arm_lists: The fields `pack.objects.ARM_LISTS`, which all arms share.
        device: Warp's name of the device.
    """
    arms, names = plan.reaching.arms, [o.name for o in plan.objects]
    late = {target.arm for target in plan.reaching.targets if target.late}
    bases = [names.index(one.robot) if i in late else UNASKED for i, one in enumerate(arms)]
    shared = _target_arrays(plan, bases)
    for i, one in enumerate(arms):
        set_map_and_arm(one, device)
        one.view.number, one.view.last, one.view.base_obj = i, len(arms) - 1, bases[i]
        own = _arm_fields(plan.scene, plan.scene.home, one)
        fill_struct(Reach, one.view, {**arm_lists, **shared, **own}, device)


def set_map_and_arm(one: ReachingArm, device: str) -> None:
    """Set the parts of an arm's view that are structs of their own."""
    one.view.map = MapView() if one.map is None else one.map.view(device)
    one.view.arm = arm_view(one.arm, device)


def _arm_fields(scene: SceneModel, home: mujoco.MjData, one: ReachingArm) -> dict[str, np.ndarray]:
    """Set the plain fields of an arm's view, and return its arrays that differ between arms."""
    view, gripper, present = one.view, one.gripper, one.robot not in scene.apart
    hand = sorted(carried(scene.mjm, one.arm)) if present else []
    view.base_body = scene.bodies[one.robot]
    view.mapped = one.map is not None
    view.gap_closed, view.gap_open = gripper.closed, gripper.opening
    if present:
        site, body = one.arm.tcp_site, hand[0]
        back = home.site_xmat[site].reshape(3, 3).T
        view.hand_pos = wp.vec3(*(back @ (home.xpos[body] - home.site_xpos[site])))
        view.hand_quat = wp.vec4(*product(quaternion(back), home.xquat[body]))
    return {
        "arm_qposadr": one.arm.qposadr if present else np.zeros(0, int),
        "arm_body": np.array(scene.subtree(one.robot)[1:], int),
        "hand_body": np.array(hand, int),
        "grip_qposadr": gripper.qposadr,
        "grip_closed": gripper.closed_qpos,
        "grip_open": gripper.open_qpos,
        **coupling_arrays(gripper.couplings),
    }


def _target_arrays(plan: Plan, bases: list[int]) -> dict[str, np.ndarray]:
    """Return the arrays that all arms share: reach targets, their grasps, and an empty bank."""
    targets, rows = plan.reaching.targets, len(plan.reaching.targets)
    grasps, fields = addressed("reach_grasp", (t.grasp_set.grasps for t in targets))
    numbers = np.full(len(plan.objects), UNASKED)
    numbers[[t.number for t in targets]] = np.arange(rows)
    numbers[[base for base in bases if base != UNASKED]] = BASE
    spans = [np.zeros((len(o.variants), 2), int) for o in plan.objects]
    for target, first in zip(targets, fields["reach_graspadr"], strict=True):
        spans[target.number] = np.array(target.grasp_set.spans) + [int(first), 0]
    variants = np.concatenate([np.zeros((0, 2), int), *spans])  # address and number of the grasps of each
    return {
        "obj_reach": numbers,
        "variant_graspadr": variants[:, 0],
        "variant_graspnum": variants[:, 1],
        "reach_obj": np.array([t.number for t in targets], int),
        "reach_slot": np.array([plan.slots.index(t.name) for t in targets], int),
        **columns("reach", targets, arm=1, late=1, early=1, tier=1),
        "reach_least": np.array([t.tier.least_verdict for t in targets], int),
        "reach_below": np.array([plan.objects[t.number].ground is not None for t in targets], int),
        **fields,
        "early_grasp": np.flatnonzero([t.early for t in targets for _ in t.grasp_set.grasps]),
        "grasp_reach": np.repeat(np.arange(rows), fields["reach_graspnum"]),
        **columns("grasp", grasps, body=1, pos=3, quat=4, opening=1),
    }

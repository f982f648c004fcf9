"""Claims of layouts that an arm reaches an object, for the audit."""

from dataclasses import replace

import numpy as np

from sceniris_gym.audit.chain import Chain
from sceniris_gym.audit.reach import Claim, ReachAudit, Unreached
from sceniris_gym.config.member_names import variant_of
from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.reaching.poses import OPENING_MARGIN
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable


def reach_claims(compiled: CompiledScene, table: LayoutTable) -> list[Claim]:
    """Return a claim for each reach target: a table's grasps and arm joints. Fingers are 1 cm wider than needed.

    Layouts that start on a path to a target also claim the path.
    """
    if compiled.reaching is None:
        return []
    claims, kinds, variants = [], compiled.config.start, compiled.config.variants
    # an arm that starts with a held object would have to put it down first
    full = np.isin(table.start, [i for i, kind in enumerate(kinds) if kind.is_held])
    for k, target in enumerate(compiled.reaching.targets):
        one, config = compiled.reaching.arm_of(target), compiled.config.objects[target.name]
        word = config.grasp
        gripper, joints = one.gripper, slice(0, len(one.arm.joints))
        needed = np.array([g.opening for g in target.grasp_set.grasps])[np.maximum(table.grasp[:, k], 0)]
        gap = np.minimum(needed + OPENING_MARGIN, gripper.opening)
        share = np.clip((gap - gripper.closed) / max(gripper.opening - gripper.closed, 1e-6), 0.0, 1.0)
        finger_adr, fingers = gripper.poses(share)
        claims.append(
            Claim(
                name=target.name,
                robot=one.robot,
                rows=table.present[:, compiled.slots.index(target.name)] & ~full,
                tier=target.tier,
                pose=table.grasp_pose[:, k],
                qpos=table.grasp_qpos[:, k, joints],
                pregrasp_qpos=table.pregrasp_qpos[:, k, joints],
                path=table.path[:, k].reshape(len(table), 3, table.path.shape[2] // 3)[..., joints],
                fingers=fingers,
                finger_adr=finger_adr,
                pattern=None if word in config.parts else word,
                part=config.joint_of(word, variant_of(target.name)) if word in config.parts else None,
            )
        )
        begun = [i for i, kind in enumerate(kinds) if kind.robot == "path" and target.name in kind.targets(variants)]
        if begun and target.tier < Tier.PATH:
            rows = claims[-1].rows & np.isin(table.start, begun)
            claims.append(replace(claims[-1], rows=rows, tier=Tier.PATH))
    return claims


def judge_reach(compiled: CompiledScene, table: LayoutTable, claims: list[Claim]) -> list[Unreached]:
    """Test the claims of `reach_claims` with MuJoCo C, and return the failures."""
    scene, found = compiled.scene, []
    for robot in dict.fromkeys(claim.robot for claim in claims):
        home, name = scene.home_of(robot)
        tcp = home.tcps[name]
        chain = None if home is scene else Chain(home.mjm, home.bodies[name], home.mjm.site(tcp).id)
        audit = ReachAudit(compiled.mjm, scene.bodies[robot], scene.bodies, tcp, chain)
        found += audit.judge(table, [claim for claim in claims if claim.robot == robot])
    return found

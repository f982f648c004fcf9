"""A scene with every kind of start, and its starts as MuJoCo C steps them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer

HOME, PREGRASP, STANDING, LIFTED, HELD, PLACED, HANDLE = range(7)
"""The kinds of `SCENE`."""
LIFT = (0.05, 0.2)
_SECONDS = 0.5
SCENE: dict[str, Any] = {
    "floor": {"size": [1.4, 1.2]},
    "robot": {"asset": "panda", "base": [-0.438, -0.114, 0.0], "joints": {"joint*": {"noise": 0.02}}},
    "objects": {
        "cabinet": {
            "asset": "cabinet",
            "kind": "fixture",
            "on": "floor",
            "reachable": "clear",
            "region": {"box": [[0.05, 0.15], [0.15, 0.25]]},
            "orientation": {"yaw": [-5, 5]},
            "joints": {"upper": {"value": 0.0}},
        },
        "block": {
            "asset": "block",
            "on": "floor",
            "ratio_on_support": 1,
            "reachable": "map",
            "region": {"box": [[0.0, -0.4], [0.3, -0.1]]},
        },
        "apple": {"asset": "apple", "on": "floor", "region": {"box": [[0.4, -0.3], [0.65, -0.1]]}},
        "goal": {"kind": "marker", "on": "floor", "region": {"box": [[0.4, 0.1], [0.65, 0.3]]}},
    },
    "start": [
        {"weight": 3},
        {"robot": "pregrasp", "of": "block"},
        {"robot": "grasp", "of": "block"},
        {"robot": "grasp", "of": "block", "lift": LIFT},
        {"weight": 2, "robot": "grasp", "of": "block", "robot_joints": {"joint*": {"fraction": [0.3, 0.7]}}},
        {"place": {"apple": "goal"}},
        {
            "robot": "grasp",
            "of": "cabinet",
            "grasp": "upper_handle*",
            "joints": {"cabinet/upper": {"fraction": [0.8, 1]}},
        },
    ],
    "bank": 8,
}


@cache
def starting() -> CompiledScene:
    """Return the compiled scene, one for all tests of a process."""
    return compile_scene(SCENE, "cpu")


@dataclass(frozen=True)
class Held:
    """A start with something in the hand after a while without an action.

    Attributes:
        kind: The number of its kind.
        drift: Movement of the object in the frame of the TCP [m].
        fingers: Number of the robot's bodies that touch it at the end.
        others: Steps in which the robot, or what it holds in the air, touches anything else.
        qpos: The state at the start, as bytes, to count starts that differ.
        fallback: Whether the start is from the bank.
    """

    kind: int
    drift: float
    fingers: int
    others: int
    qpos: bytes
    fallback: bool


def reset_worlds(compiled: CompiledScene, nworld: int, seed: int = 0) -> tuple[mjw.Data, Layouts]:
    """Return worlds that were reset once, and their layouts."""
    model, data = make_worlds(compiled, nworld)
    randomizer = ResetRandomizer(compiled, model, data, seed=seed)
    randomizer.reset()
    return data, randomizer.layouts


def held_starts(compiled: CompiledScene, starts: int, worlds: int = 100, every: int = 5) -> list[Held]:
    """Return what `stepped` finds in a number of starts, which are reset in batches of so many worlds."""
    found: list[Held] = []
    for seed in range(0, starts, worlds):
        data, layouts = reset_worlds(compiled, min(worlds, starts - seed), seed)
        found += stepped(compiled, data, layouts, every=every)
    return found


def stepped(compiled: CompiledScene, data: mjw.Data, layouts: Layouts, every: int = 1) -> list[Held]:
    """Step the worlds in whose start something is held by MuJoCo C for half a second, with the controls of the reset.

    Contacts with anything else are looked for in every so manieth step.
    """
    mjm, scene, found = compiled.mjm, compiled.scene, []  # the model that has all variants
    state = {name: getattr(layouts, name).cpu().numpy() for name in ("qpos", "mocap_pos", "mocap_quat", "present")}
    state |= {name: getattr(data, name).numpy() for name in ("ctrl", "act")}
    own = mujoco.MjData(mjm)
    for worldid, number in enumerate(layouts.start.cpu().numpy().tolist()):
        kind = compiled.config.start[number]
        if kind.robot != "grasp":
            continue
        mujoco.mj_resetData(mjm, own)
        for name in ("qpos", "mocap_pos", "mocap_quat", "ctrl", "act"):
            getattr(own, name)[:] = state[name][worldid][: len(getattr(own, name))]
        names = kind.targets(compiled.config.variants)
        (of,) = (name for name in names if state["present"][worldid, compiled.slots.index(name)])
        robot_name = compiled.config.robot_for(of)
        robot, thing = set(scene.subtree(robot_name)), set(scene.subtree(of))
        root, tcp = scene.bodies[of], mjm.site(scene.tcps[robot_name]).id
        if not mjm.body_dofnum[root]:  # a drawer moves inside its cabinet
            root = max(thing, key=lambda body: own.model.body_dofnum[body])
        mujoco.mj_forward(mjm, own)
        before, others = _in_hand(own, root, tcp), 0
        for step in range(round(_SECONDS / mjm.opt.timestep)):
            others += step % every == 0 and any(
                _strays(mjm, contact, robot, thing, kind.is_held) for contact in own.contact[: own.ncon]
            )
            mujoco.mj_step(mjm, own)
        mujoco.mj_forward(mjm, own)
        touching = {
            int(body)
            for contact in own.contact[: own.ncon]
            for body in mjm.geom_bodyid[contact.geom]
            if thing.intersection(mjm.geom_bodyid[contact.geom].tolist()) and int(body) in robot
        }
        drift = float(np.linalg.norm(_in_hand(own, root, tcp) - before))
        is_fallback = int(layouts.status[worldid]) == LayoutStatus.FALLBACK
        found.append(Held(number, drift, len(touching), others, state["qpos"][worldid].tobytes(), is_fallback))
    return found


def _in_hand(data: mujoco.MjData, body: int, tcp: int) -> np.ndarray:
    """Return the position of a body in the frame of the TCP [m], shape (3,)."""
    return data.site_xmat[tcp].reshape(3, 3).T @ (data.xpos[body] - data.site_xpos[tcp])


def _strays(mjm: mujoco.MjModel, contact: Any, robot: set[int], thing: set[int], in_the_air: bool) -> bool:
    """Return whether a contact is one of the robot, or of a thing in the air, with anything else."""
    bodies = set(mjm.geom_bodyid[contact.geom].tolist())
    moving = robot | thing if in_the_air else robot
    return contact.dist < 0.0 and bool(bodies & moving) and not bodies <= robot | thing

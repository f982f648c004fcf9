"""An arm whose reach is known in closed form, its map, and scenes with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import ReachMap

# The TCP points straight down and is anywhere in a ring around the first axis, at any height of an interval [m].
# All limits lie midway between corners of the map's tables, where its verdict turns exactly there.
RADIUS = (0.305, 0.595)
HEIGHT = (0.005, 0.405)
_SLIDES = f'<joint name="out" type="slide" axis="1 0 0" range="{RADIUS[0]} {RADIUS[1]}"/>'
_FINGER = '<body name="{0}" pos="0 0 -0.02"><joint name="{0}" type="slide" axis="0 {1} 0" range="0 0.04"/>'
_PAD = '<geom type="box" size="0.01 0.004 0.02" pos="0 {0} 0.018" {1}/></body>'
_AIRY = 'contype="2" conaffinity="0"'


def crane_mjcf(
    folder: Path,
    name: str = "crane",
    *,
    turn: float = 3.2,
    tilt: float = 0.0,
    offset: float = 0.0,
    solid: bool = False,
) -> str:
    """Write a crane: a turntable, a slide outwards, one up and down, and a hand that turns and points down.

    Args:
        folder: where to.
        name: of the file and of its root body.
        turn: limit of the first joint, to both sides [rad].
        tilt: lean of the first axis from the vertical [rad].
        offset: of the TCP from the last joint's axis [m].
        solid: whether its hand touches things; the rest of it does not.
    """
    bits = "" if solid else _AIRY
    sides = {"left": 1, "right": -1}
    fingers = "".join(_FINGER.format(side, y) + _PAD.format(0.004 * y, bits) for side, y in sides.items())
    hand = (
        '<body name="hand" pos="0 0 0" quat="0 1 0 0"><joint name="roll" axis="0 0 1" range="-3.2 3.2"/>'
        f'<geom type="box" size="0.02 0.06 0.01" pos="0 0 -0.06" {bits}/>'
        f'<site name="tcp" pos="{offset} 0 0"/>{fingers}</body>'
    )
    up = f'<body name="up"><joint name="up" type="slide" axis="0 0 1" range="{HEIGHT[0]} {HEIGHT[1]}"/>'
    up += f'<geom type="sphere" size="0.01" {_AIRY}/>{hand}</body>'
    out = f'<body name="out">{_SLIDES}<geom type="sphere" size="0.01" {_AIRY}/>{up}</body>'
    c, s = np.cos(tilt / 2), np.sin(tilt / 2)
    table = f'<body name="table" quat="{c} {s} 0 0"><joint name="turn" axis="0 0 1" range="{-turn} {turn}"/>'
    table += f'<geom type="sphere" size="0.01" {_AIRY}/>{out}</body>'
    base = '<geom type="cylinder" size="0.05 0.005" pos="0 0 0.005"/>'
    key = '<keyframe><key name="home" qpos="0 0.4 0.3 0 0.04 0.04"/></keyframe>'
    path = folder / f"{name}.xml"
    compiler = '<compiler angle="radian" autolimits="true"/>'
    path.write_text(f'<mujoco>{compiler}<worldbody><body name="{name}">{base}{table}</body></worldbody>{key}</mujoco>')
    return str(path)


def crane_map(
    asset: str,
    *,
    turn_error: float = 0.0,
    false_accepts: float | None = None,
    step: float = 0.01,
    upwards: bool = False,
) -> Path:
    """Write the map of a crane beside it, from what is known of its reach.

    Args:
        asset: the crane.
        turn_error: share of verdicts that depend on turns.
        false_accepts: share of accepted poses that are out of reach; None for a map that was not measured.
        step: of the map's tables [m].
        upwards: whether it is the map of a crane whose hand points up.
    """
    path = Path(asset)
    arm = SerialArm.from_model(mujoco.MjModel.from_xml_path(asset), path.stem)
    z = -0.1 + step * np.arange(round(0.7 / step))
    r = step * np.arange(round(0.8 / step))
    inside = np.minimum(
        np.minimum(z[:, None] - HEIGHT[0], HEIGHT[1] - z[:, None]), np.minimum(r - RADIUS[0], RADIUS[1] - r)
    )
    codes = np.where(inside >= 0.0, 10 + _level(inside / step), 5 - _level(-inside / step)).astype(np.uint8)
    poles = np.stack([codes, np.zeros_like(codes)] if upwards else [np.zeros_like(codes), codes])
    made = ReachMap(
        arm=arm,
        step=0.2,
        tilt_step=np.pi / 2,
        z_low=-1.0,
        u_low=-1.0,
        nz=11,
        ntilt=3,
        nu=11,
        rows=np.zeros((121, 3), np.int32),
        codes=np.zeros(1, np.uint32),
        pole_step=step,
        pole_z_low=-0.1,
        poles=poles,
        wit_cells=np.zeros((3, 1, 3, 3, 2), np.int32),
        wit_joints=np.zeros((0, len(arm.joints)), np.float16),
        turn_error=turn_error,
        seed=0,
        false_accepts=false_accepts,
    )
    path = path.with_suffix(".reach")
    made.save(path)
    return path


def _level(steps: np.ndarray) -> np.ndarray:
    """Distances in steps as codes count them from the surface on: 0.1, 0.3, 0.5, 0.7, 0.9 and more."""
    return np.clip(np.floor(5.0 * steps), 0, 5).astype(int)


def crane_scene(asset: str, thing: str, **words: Any) -> dict[str, Any]:
    """A crane off the middle of a floor, turned, with its map if there is one, and one thing to reach."""
    beside = Path(asset).with_suffix(".reach")
    known = {"map": str(beside)} if beside.is_file() else {}
    return {
        "floor": {"size": [2.0, 2.0]},
        "robot": {"asset": asset, "base": [0.2, -0.1, 0.0], "yaw": 70.0, **known},
        "objects": {"thing": {"asset": thing, "on": "floor", "reachable": "map", **words}},
    }

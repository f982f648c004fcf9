"""Limits of fixed tendons: draws that would go beyond them are refused, judged by MuJoCo's own lengths and rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.couplings import follow
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import write_mjcf
from tests.program.scenes import checked, scene_of

SLIDES = '<geom type="box" size=".02 .02 .02"/>' + "".join(
    f'<body name="{n}" pos="0 {x} 0"><joint name="{n}" type="slide" range="-.1 .2"/><geom size=".01"/></body>'
    for n, x in (("p", 0.1), ("q", 0.2), ("r", 0.3))
)
BENT = '<equality><joint joint1="r" joint2="p" polycoef=".01 .5 -3"/></equality>'
TENDON = """<tendon><fixed name="cable" limited="{limited}" range="{low} {high}">
  <joint joint="p" coef="1"/><joint joint="q" coef="-2"/><joint joint="r" coef="-1.5"/></fixed></tendon>"""
HOME = '<keyframe><key name="home" qpos="{} 0 0"/></keyframe>'


def rack(
    folder: Path, joints: dict[str, Any], limits: tuple[float, float], rest: str = "", limited: str = "true"
) -> SceneModel:
    """Three slides and a cable over them."""
    tendon = TENDON.format(limited=limited, low=limits[0], high=limits[1])
    asset = write_mjcf(folder, "rack", SLIDES, tendon + rest)
    return scene_of({"rack": {"asset": asset, "kind": "fixture", "on": "floor", "joints": joints}})


def draws(scene: SceneModel, count: int = 20_000) -> np.ndarray:
    """Positions from the intervals of the plan, their ends among them, with what follows."""
    rng = np.random.default_rng(0)
    qpos = np.tile(scene.home_qpos, (count, 1))
    for o in build_plan(scene).objects:
        for d in o.joint_ranges:
            parts = np.array(d.intervals)[rng.integers(len(d.intervals), size=count)]
            qpos[:, d.qposadr] = parts[:, 0] + np.clip(rng.uniform(-0.5, 1.5, size=count), 0, 1) * np.ptp(parts, axis=1)
    follow(scene.couplings, qpos)
    return qpos


def lengths(scene: SceneModel, qpos: np.ndarray) -> np.ndarray:
    """MuJoCo's own."""
    data, found = mujoco.MjData(scene.mjm), []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(scene.mjm, data)
        mujoco.mj_comPos(scene.mjm, data)
        mujoco.mj_tendon(scene.mjm, data)
        found.append(data.ten_length[0])
    return np.array(found)


@pytest.mark.parametrize(
    ("joints", "rest"),
    [
        ({"p": {"range": [-0.05, 0.1]}, "q": {"fraction": [0.2, 0.6]}}, ""),
        ({"p": {"choice": [-0.1, 0.0, 0.2]}, "q": {"value": 0.05}, "r": {"noise": 0.5}}, ""),
        ({"p": {"range": [-0.1, 0.2]}}, BENT),  # cable and finger turn back in between
        ({"p": {"noise": 0.05}, "q": {"noise": 0.05}}, BENT),
    ],
)
def test_limits_are_judged_by_what_mujoco_measures_over_all_draws(tmp_path: Path, joints: dict[str, Any], rest: str):
    """A cable with room for its lengths is fine, with 1 mm less it is refused, at both ends; joints that follow too."""
    free = rack(tmp_path, joints, (-9, 9), rest)
    found = lengths(free, draws(free))
    low, high = float(found.min()), float(found.max())
    checked(rack(tmp_path, joints, (low - 1e-3, high + 1e-3), rest))
    for limits in ((low + 1e-3, high + 1e-3), (low - 1e-3, high - 1e-3)):
        with pytest.raises(SceneKeyError) as caught:
            checked(rack(tmp_path, joints, limits, rest))
        for text in ("tendon 'rack/cable'", "'rack/p'", f"[{limits[0]:g}, {limits[1]:g}]", "smaller ranges"):
            assert text in str(caught.value)


def test_no_row_of_a_limit_is_beyond_it_in_what_is_accepted(tmp_path: Path):
    """MuJoCo's own constraint rows."""
    scene = rack(tmp_path, {"p": {"fraction": [0.2, 0.6]}, "r": {"noise": 0.05}}, (-0.13, 0.16))
    data, kinds = mujoco.MjData(scene.mjm), mujoco.mjtConstraint
    for row in draws(scene, 500):
        data.qpos[:] = row
        mujoco.mj_forward(scene.mjm, data)
        limits = np.isin(data.efc_type, [kinds.mjCNSTR_LIMIT_JOINT, kinds.mjCNSTR_LIMIT_TENDON])
        assert data.efc_pos[limits].min(initial=0.0) > -1e-6


def test_limits_that_act_on_nothing_drawn_or_on_nothing_at_all_are_left_alone(tmp_path: Path):
    """A cable over joints that keep their start pose, one without limits, and limits that the model switches off."""
    joints = {"p": {"fraction": [0, 1]}}
    off = '<option><flag limit="disable"/></option>'
    with pytest.raises(SceneKeyError, match="tendon 'rack/cable'"):
        checked(rack(tmp_path, joints, (-0.01, 0.01)))
    checked(rack(tmp_path, {}, (-0.01, 0.01)))
    checked(rack(tmp_path, joints, (-0.01, 0.01), limited="false"))
    model = tmp_path / "own.xml"
    tendon = TENDON.format(limited="true", low=-0.01, high=0.01)
    body = f'<worldbody><body name="rack">{SLIDES}</body></worldbody>'
    objects = {"rack": {"kind": "static", "joints": joints}}
    for option, fits in ((off, True), ("", False)):
        model.write_text(f"<mujoco>{option}{body}{tendon}</mujoco>")
        scene = scene_of(objects, model=str(model))
        if fits:
            checked(scene)
        else:
            with pytest.raises(SceneKeyError, match="tendon 'cable'"):
                checked(scene)


def test_a_start_pose_beyond_a_limit_may_be_kept_but_not_left_further(tmp_path: Path):
    """No layout makes the excess of home worse."""
    key = HOME.format(0.15)
    checked(rack(tmp_path, {"p": {"value": 0.15}, "q": {"range": [0, 0.05]}}, (-0.2, 0.1), key))
    with pytest.raises(SceneKeyError, match=r"tendon 'rack/cable' 0\.15 to 0\.16 long"):
        checked(rack(tmp_path, {"p": {"range": [0.15, 0.16]}}, (-0.2, 0.1), key))

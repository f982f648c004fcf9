"""Firm grasps, held by another simulation in MuJoCo C than the package's."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.crane import crane_mjcf
from tests.layout.scenes import write_mjcf

OFF = {"end": 0.13, "quarter": 0.07, "near": 0.01, "middle": 0.0}
"""Distance of the grasps from the middle of the bar [m]. The first are at its ends, which turn out of the fingers."""


def bar_scene(folder: Path, mass: float = 0.6, **words: Any) -> dict[str, Any]:
    """Return a scene of a Panda and a bar with four grasps from above, along the whole of it."""
    sites = "".join(f'<site name="grasp_{name}" pos="{x} 0 .025" quat="0 1 0 0"/>' for name, x in OFF.items())
    bar = write_mjcf(folder, "bar", f'<geom type="box" size=".15 .015 .025" pos="0 0 .025" mass="{mass}"/>{sites}')
    near = {"region": {"box": [[0.4, -0.2], [0.6, 0.2]]}}
    return {
        "floor": {"size": [2.4, 2.0]},
        "robot": {"asset": "panda", "base": [0, 0, 0]},
        "objects": {"bar": {"asset": bar, "on": "floor", **near, "reachable": "ik", **words}},
    }


def slip(scene: dict[str, Any], name: str) -> float:
    """Return how far the bar moves in the closed hand in half a second under twice its weight [m].

    The hand closes on the floating bar. Then gravity pulls the bar towards the fingertips, wherever the arm points.
    """
    model = build_model(SceneConfig.load(scene))
    mjm, data = model.mjm, mujoco.MjData(model.mjm)
    data.qpos[:] = model.home_qpos
    bar, tcp, site = mjm.body("bar").id, mjm.site("panda/tcp").id, mjm.site(f"bar/grasp_{name}").id
    hand = {mjm.body(f"panda/{part}").id for part in ("hand", "left_finger", "right_finger")}
    apart = ~np.isin(mjm.geom_bodyid, [*hand, bar])
    mjm.geom_contype[apart] = mjm.geom_conaffinity[apart] = 0
    mjm.body_gravcomp[:] = [float(body != bar) for body in range(mjm.nbody)]
    adr = mjm.jnt_qposadr[mjm.body_jntadr[bar]]
    for joint in ("finger_joint1", "finger_joint2"):
        data.qpos[mjm.joint(f"panda/{joint}").qposadr[0]] = 0.03
    mujoco.mj_kinematics(mjm, data)
    turn = data.site_xmat[tcp].reshape(3, 3) @ data.site_xmat[site].reshape(3, 3).T
    pos = data.site_xpos[tcp] + turn @ (data.xpos[bar] - data.site_xpos[site])
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, (turn @ data.xmat[bar].reshape(3, 3)).ravel())
    data.qpos[adr : adr + 7] = [*pos, *quat]
    arm = [mjm.joint(f"panda/joint{i}").qposadr[0] for i in range(1, 8)]
    data.ctrl[:] = [*model.home_qpos[arm], 0.0]

    def seen() -> np.ndarray:
        mujoco.mj_kinematics(mjm, data)
        return data.site_xmat[tcp].reshape(3, 3).T @ (data.xpos[bar] - data.site_xpos[tcp])

    down = data.site_xmat[tcp].reshape(3, 3)[:, 2]  # the grasps are from above
    moved = []
    for gravity, seconds in ((0.0, 0.3), (2.0 * 9.81, 0.5)):
        mjm.opt.gravity[:] = gravity * down
        before = seen()
        for _ in range(round(seconds / mjm.opt.timestep)):
            mujoco.mj_step(mjm, data)
        moved.append(float(np.linalg.norm(seen() - before)))
    return moved[-1]


def test_the_grasps_that_count_are_those_that_hold(tmp_path: Path):
    """By both simulations: at the ends, the bar turns out of the fingers."""
    scene = bar_scene(tmp_path, firm=True)
    (target,) = build_plan(build_model(SceneConfig.load(scene))).reaching.targets
    firm = {grasp.name.removesuffix(" rolled").removeprefix("grasp_") for grasp in target.grasp_set.grasps}
    found = {name: slip(scene, name) for name in OFF}
    assert found["end"] > 4e-3, found
    assert firm == {name for name, moved in found.items() if moved < 1e-3}, found
    assert 0 < len(firm) < len(OFF)


@pytest.mark.parametrize("tier", ["map", "path"])
def test_layouts_and_redraws_use_firm_grasps_alone(tmp_path: Path, tier: str):
    """Without the word, the first grasp in reach counts, which is at the end. The word changes the hash."""
    hashes, names = set(), []
    for firm in (False, True):
        scene = bar_scene(tmp_path, reachable=tier, firm=firm) | {"bank": 2}
        compiled = compile_scene(scene, "cpu")
        generator = LayoutGenerator(compiled, 24)
        generator.generate()
        redrawn = generator.redraw(generator.layouts, ["bar"])
        assert compiled.reaching is not None
        grasps = compiled.reaching.targets[0].grasp_set.grasps
        found = torch.cat([generator.layouts.grasp[:, 0], redrawn.grasp[:, 0]])
        names.append({grasps[i].name.removesuffix(" rolled") for i in found})
        hashes.add(compiled.hash)
    assert "grasp_end" in names[0]
    assert "grasp_end" not in names[1]
    assert len(hashes) == 2


def test_an_object_without_a_firm_grasp_is_refused(tmp_path: Path):
    """By its key, with its least motion, and what would be right."""
    says = (
        r"objects\.bar\.firm: .* hold 'bar' upright in the air .*: in the best it moves by [\d.]+ mm \(limit 1\)\. With"
    )
    with pytest.raises(SceneKeyError, match=says):
        build_plan(build_model(SceneConfig.load(bar_scene(tmp_path, 30.0, firm=True)))).reaching  # noqa: B018


def test_a_robot_that_cannot_hold_is_refused(tmp_path: Path):
    """One outside of the scene, and one without fingers."""
    scene = bar_scene(tmp_path, reachable="map", firm=True)
    scene["robot"]["in_scene"] = False
    with pytest.raises(SceneKeyError, match=r"objects\.bar\.firm: needs the robot in the scene"):
        build_plan(build_model(SceneConfig.load(scene))).reaching  # noqa: B018
    file = Path(crane_mjcf(tmp_path))
    text = re.sub('<joint name="(left|right)"[^>]*>', "", file.read_text())
    file.write_text(text.replace(" 0.04 0.04", ""))
    words = {**bar_scene(tmp_path, firm=True), "robot": {"asset": str(file)}}
    with pytest.raises(NotSupportedError, match=r"'robot' has no fingers that close on 'bar'.* remove 'firm'"):
        build_plan(build_model(SceneConfig.load(words))).reaching  # noqa: B018

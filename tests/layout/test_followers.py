"""Joints that follow drawn ones keep MuJoCo's own equalities, in every layout, object and robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reaching.search import ReachStep
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.grasped import arm_mjcf, taken
from tests.layout.scenes import ANYWHERE, Rows, box_mjcf, compile_on_cpu, make, read, write_mjcf

# Two doors geared against each other, and a bolt that a cam on the right one drives; references are not zero.
DOORS = """
<geom type="box" size=".2 .01 .2"/>
<body name="left" pos="-.2 -.05 0"><joint name="left" axis="0 0 1" range="-100 100" ref="10"/>
  <geom type="box" size=".08 .005 .15" pos=".1 0 0"/></body>
<body name="bolt" pos="0 .1 0"><joint name="bolt" type="slide" axis="0 1 0" range="-1 2" ref=".1"/>
  <geom type="box" size=".01 .01 .01"/></body>
<body name="right" pos=".2 -.05 0"><joint name="right" axis="0 0 1" range="-100 100" ref="-5"/>
  <geom type="box" size=".08 .005 .15" pos="-.1 0 0"/></body>
"""
GEARS = """<equality>
  <joint name="cam" joint1="bolt" joint2="right" polycoef=".05 .02 .1 -.03 .04"/>
  <joint name="gear" joint1="right" joint2="left" polycoef="0 -1 0 0 0"/>
  <joint name="off" joint1="left" joint2="bolt" active="false"/>
</equality>"""
# A hand whose right finger mirrors the left one.
ARM = """
<geom type="cylinder" size=".05 .02"/>
<body name="link" pos="0 0 .2"><joint name="turn" axis="0 0 1" range="-170 170"/><geom type="capsule" size=".02 .1"/>
  <body name="left" pos=".02 0 .2"><joint name="left" type="slide" axis="0 1 0" range="0 .041"/>
    <geom type="box" size=".01 .004 .03" pos="0 .01 0"/></body>
  <body name="right" pos=".02 0 .2"><joint name="right" type="slide" axis="0 1 0" range="-.04 0"/>
    <geom type="box" size=".01 .004 .03" pos="0 -.01 0"/></body>
</body>"""
MIMIC = '<equality><joint name="mimic" joint1="right" joint2="left" polycoef="0 -1 0 0 0"/></equality>'


def violation(compiled: CompiledScene, rows: Rows) -> tuple[float, float]:
    """The largest miss of an equality [m or rad] and acceleration that MuJoCo C finds at the start of the rows."""
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    mjm.opt.gravity[:] = 0.0
    worst, acc = 0.0, 0.0
    for i in range(len(rows.qpos)):
        mujoco.mj_resetData(mjm, data)
        data.qpos[:] = rows.qpos[i]
        if mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = rows.mocap_pos[i], rows.mocap_quat[i]
        mujoco.mj_forward(mjm, data)
        ties = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert ties.sum() == mjm.eq_active0.sum()
        worst, acc = max(worst, np.abs(data.efc_pos[ties]).max()), max(acc, np.abs(data.qacc).max())
    return worst, acc


@pytest.mark.parametrize("kind", ["free", "fixture", "static"])
def test_geared_doors_follow_in_every_layout(tmp_path: Path, kind: str):
    """A chain of two equalities in the wrong order, references that are not zero, a pattern for all joints."""
    asset = write_mjcf(tmp_path, "doors", DOORS, GEARS)
    doors: dict[str, Any] = {"asset": asset, "kind": kind, "joints": {"*": {"range": [-0.5, 0.5]}}}
    if kind != "static":
        doors["region"] = {"box": ANYWHERE}
    compiled = compile_on_cpu({"objects": {"doors": doors}})
    rows = make(compiled, 64, seed=3)
    assert (rows.status == 1).all()
    adr = {name: compiled.mjm.joint(f"doors/{name}").qposadr[0] for name in ("left", "right", "bolt")}
    assert np.ptp(rows.qpos[:, adr["left"]]) > 0.5
    assert np.ptp(rows.qpos[:, adr["bolt"]]) > 0.05
    worst, acceleration = violation(compiled, rows)
    assert worst < 1e-6
    assert acceleration < 0.01
    bank = (compiled.bank.qpos.numpy(), compiled.bank.mocap_pos.numpy(), compiled.bank.mocap_quat.numpy())
    assert violation(compiled, Rows(*bank, rows.status, rows.attempts))[0] < 1e-6


def test_bodies_stand_where_mujoco_has_them_when_joints_follow(tmp_path: Path):
    """The state that is tested for collision is the one that is served."""
    asset = write_mjcf(tmp_path, "doors", DOORS, GEARS)
    doors = {"asset": asset, "kind": "fixture", "region": {"box": ANYWHERE}, "joints": {"left": {"range": [-0.5, 0.5]}}}
    compiled = compile_on_cpu({"objects": {"doors": doors}})
    generator = LayoutGenerator(compiled, 32)
    generator.generate()
    rows, data = read(generator.layouts), mujoco.MjData(compiled.mjm)
    for i, pos in enumerate(generator.layouts.view.body_pos.numpy()):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = rows.qpos[i], rows.mocap_pos[i], rows.mocap_quat[i]
        mujoco.mj_kinematics(compiled.mjm, data)
        np.testing.assert_allclose(pos, data.xpos, atol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_random_polynomials_are_followed_as_mujoco_means_them(tmp_path: Path, seed: int):
    """Chains of random length and order, of hinges and slides, some of them held."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    bodies, ties = "", []
    for j in range(count):
        kind, ref = rng.choice(["hinge", "slide"]), rng.uniform(-0.5, 0.5)
        axis = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
        bodies += (
            f'<body name="b{j}" pos="{j} 0 0"><joint name="j{j}" type="{kind}" axis="{axis}" ref="{ref:.3f}"/>'
            '<geom type="box" size=".05 .05 .05"/></body>'
        )
        coef = " ".join(f"{x:.3f}" for x in rng.uniform(-0.2, 0.2, 5))
        if j:
            driver = f'joint2="j{rng.integers(0, j)}"' if rng.random() < 0.8 else ""
            ties.append(f'<joint joint1="j{j}" {driver} polycoef="{coef}"/>')
    rng.shuffle(ties)
    rest = f'<compiler angle="radian"/><equality>{"".join(ties)}</equality>'
    asset = write_mjcf(tmp_path, "chain", f'<geom type="box" size=".05 .05 .05" pos="-1 0 0"/>{bodies}', rest)
    words = {"asset": asset, "kind": "fixture", "region": {"box": ANYWHERE}, "joints": {"*": {"range": [-0.5, 0.5]}}}
    compiled = compile_on_cpu({"objects": {"chain": words}, "attempts": 100})
    rows = make(compiled, 64)
    assert (rows.status == 1).all()
    worst, acceleration = violation(compiled, rows)
    assert worst < 1e-6
    assert acceleration < 0.01


def test_a_robot_s_mimic_finger_follows_noise_and_home(tmp_path: Path):
    """Noise ends where the finger that follows meets its limit; a keyframe that breaks the equality is corrected."""
    key = '<keyframe><key name="home" qpos=".3 .03 -.01"/></keyframe>'
    robot = {"asset": write_mjcf(tmp_path, "arm", ARM, MIMIC + key), "joints": {"*": {"noise": 0.05}}}
    compiled = compile_on_cpu({"robot": robot})
    left, right = (compiled.mjm.joint(f"arm/{name}").qposadr[0] for name in ("left", "right"))
    assert compiled.scene.home_qpos[right] == pytest.approx(-0.03)
    np.testing.assert_array_equal(compiled.mjm.key("home").qpos, compiled.scene.home_qpos)
    rows = make(compiled, 256)
    worst, acceleration = violation(compiled, rows)
    assert worst < 1e-6
    assert acceleration < 0.01
    assert rows.qpos[:, left].max() == pytest.approx(0.04, abs=1e-3)
    assert rows.qpos[:, left].max() <= 0.04 + 1e-7
    undrawn = compile_on_cpu({"robot": {"asset": robot["asset"]}})
    assert violation(undrawn, make(undrawn, 2))[0] < 1e-6


def test_absent_objects_are_parked_with_their_equalities_kept(tmp_path: Path):
    """An object that its group leaves out has all its joints at home."""
    asset = write_mjcf(tmp_path, "doors", DOORS, GEARS)
    doors = {"asset": asset, "on": "floor", "stands": False, "joints": {"left": {"range": [-0.5, 0.5]}}}
    scene = {
        "floor": {"size": [2, 2]},
        "objects": {"a": dict(doors), "b": dict(doors)},
        "groups": {"some": {"of": ["a", "b"], "count": [0, 2]}},
    }
    compiled = compile_on_cpu(scene)
    generator = LayoutGenerator(compiled, 64)
    for _ in range(2):
        generator.generate()
    present = generator.layouts.present.numpy()
    assert 0 < present.sum() < present.size
    assert violation(compiled, read(generator.layouts))[0] < 1e-6


def test_the_gripper_that_reaches_opens_with_its_fingers_coupled(tmp_path: Path):
    """The state in which the hand is tested, after reaching; grasps by the arm with its fingers drawn stay possible."""
    arm = Path(arm_mjcf(tmp_path))
    text = (
        arm.read_text().replace('"0 -1 0" range="0 0.04"', '"0 1 0" range="-0.04 0"').replace("0.02 0.02", "0.02 -0.02")
    )
    tie = '<equality><joint joint1="right" joint2="left" polycoef="0 -1"/></equality></mujoco>'
    arm.write_text(text.replace("</mujoco>", tie))
    block: dict[str, Any] = {"asset": box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04), "on": "floor", "reachable": "clear"}
    block["region"] = {"box": [[0.35, -0.15], [0.55, 0.15]]}
    compiled = compile_on_cpu({"floor": {"size": [1.5, 1.5]}, "robot": {"asset": str(arm)}, "objects": {"bar": block}})
    generator = LayoutGenerator(compiled, 16)
    generator.generate()
    assert generator._stage is not None
    posed = generator._stage.search
    passed = posed.failed.numpy() == ReachStep.PASSED
    opened = posed.qpos.numpy()[: len(passed)][passed]
    assert len(opened) > 0
    left, right = (compiled.mjm.joint(f"picker/{name}").qposadr[0] for name in ("left", "right"))
    assert np.abs(opened[:, left] - 0.02).min() > 1e-3
    np.testing.assert_array_equal(opened[:, right], -opened[:, left])
    assert all(not t.itself and not t.others for t in taken(compiled, generator.layouts, "grasp_qpos"))

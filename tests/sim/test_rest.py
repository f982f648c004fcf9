"""Controls at rest of delayed actuators: what they read from the past is what a reset gives them."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.rest import history_samples
from tests.versions import since_4

NROW = 4

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.005" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="slow" axis="0 0 1"/><geom size="0.05" pos="0.2 0 0" mass="0.5"/>
      <body pos="0.4 0 0"><joint name="out" type="slide" axis="1 0 0"/><geom size="0.05" mass="0.2"/>
        <body pos="0.2 0 0"><joint name="turn" axis="0 0 1"/><geom size="0.05" pos="0.1 0 0" mass="0.2"/></body>
      </body></body>
  </worldbody>
  <actuator>
    <position joint="slow" kp="50" kv="2" delay="0.03" nsample="8"/>
    <position joint="out" kp="200" kv="2" gear="2" delay="0.02" nsample="5" interp="linear"/>
    <position joint="turn" kp="5" kv="0.2" timeconst="0.02" delay="0.021" nsample="6" interp="cubic"/>
    <motor joint="slow" delay="0.01" nsample="3"/>
  </actuator>
  <keyframe><key name="home" ctrl="0 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture
def randomizer(tmp_path) -> ResetRandomizer:
    """Return a randomizer over stored layouts of the arm, in two worlds."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    compiled = compile_scene({"model": str(path)}, "cpu")
    qpos = np.random.default_rng(3).uniform(-0.8, 0.8, (NROW, 3)).astype(np.float32)
    nothing = np.zeros((NROW, 0, 3), np.float32), np.zeros((NROW, 0, 4), np.float32)
    rows = LayoutTable.from_states(qpos, *nothing, present=np.ones((NROW, 0), bool))
    with wp.ScopedDevice("cpu"):
        model, data = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, 2)
    return ResetRandomizer(compiled, model, data, layout_source=StoredLayouts(compiled, rows, 2))


def test_nothing_moves_while_old_controls_are_read(randomizer):
    """For 50 ms, longer than any delay, every joint stays where the reset put it."""
    for _ in range(2):
        randomizer.reset()
        placed = randomizer.data.qpos.numpy().copy()
        for _ in range(10):
            mjw.step(randomizer.model, randomizer.data)
            np.testing.assert_allclose(randomizer.data.qpos.numpy(), placed, atol=1e-5)


def test_plain_mujoco_agrees_that_nothing_pulls(randomizer):
    """From the state after a reset MuJoCo finds no actuator force for as long as the delays reach."""
    randomizer.reset()
    d, mjm = randomizer.data, randomizer.compiled.mjm
    data = mujoco.MjData(mjm)
    for world in range(2):
        mujoco.mj_resetData(mjm, data)
        for name in ("qpos", "qvel", "act", "ctrl", "history"):
            getattr(data, name)[:] = getattr(d, name).numpy()[world]
        for _ in range(10):
            mujoco.mj_step(mjm, data)
            np.testing.assert_allclose(data.actuator_force, 0.0, atol=1e-3)


def test_other_worlds_keep_their_histories(randomizer):
    """The past of a world that is not reset keeps its bits, and that of a reset world has nothing of before."""
    randomizer.reset()
    for _ in range(7):
        randomizer.data.ctrl.fill_(0.7)
        mjw.step(randomizer.model, randomizer.data)
    before = randomizer.data.history.numpy().copy()
    randomizer.reset(np.array([False, True]))
    after = randomizer.data.history.numpy()
    np.testing.assert_array_equal(after[0], before[0])
    assert not (after[1] == np.float32(0.7)).any()


@since_4("mujoco_warp lets every other control of an actuator with a delay act at once, also without a reset")
def test_a_new_control_arrives_after_its_delay(randomizer):
    """The first control after a reset acts when its delay is over, not before and not later."""
    randomizer.reset()
    d, m = randomizer.data, randomizer.model
    held = d.ctrl.numpy().copy()
    changed = held.copy()
    changed[:, 3] += 1.0  # the motor, two steps late
    d.ctrl.assign(changed)
    force = []
    for _ in range(4):
        mjw.step(m, d)
        force.append(d.actuator_force.numpy()[0, 3])
    np.testing.assert_allclose(force, [0.0, 0.0, 1.0, 1.0], atol=1e-6)


@since_4("mj_readCtrl has other arguments")
def test_samples_are_found_where_mujoco_keeps_them():
    """Addresses of an actuator's samples are those that `mj_readCtrl` reads; there are none without a delay."""
    mjm = mujoco.MjModel.from_xml_string(ARM)
    address, control = history_samples(mjm)
    assert len(address) == 8 + 5 + 6 + 3
    data = mujoco.MjData(mjm)
    data.history[address] = 100.0 + control
    for i in range(mjm.nu):
        assert data.history[mjm.actuator_historyadr[i] + 1] == mjm.actuator_history[i, 0] - 1, "that is the cursor"
        delayed = np.zeros(1)
        mujoco.mj_readCtrl(mjm, data, i, 0.0, delayed, 0)
        assert delayed[0] == 100.0 + i
    plain = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert len(history_samples(plain)[0]) == 0

"""Controls at rest: those of delayed actuators, those with gains of their own, and of fingers that hold something."""

from __future__ import annotations

import copy
import re
from importlib.resources import files

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.grasping.grip import PRESSES
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.rest import GAINS, history_samples, launch_holding, rest_map
from tests.layout.starting import HANDLE, HELD, LIFT, LIFTED, SCENE, STANDING, reset_worlds, starting, stepped
from tests.vector.workshop import mjcf
from tests.versions import since_4

NROW = 4
NWORLD = 6
MASK = np.array([True, False, True, True, False, True])
CLOSED = (STANDING, LIFTED, HELD, HANDLE)

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
GAINED = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="base" pos="0.1 0 0.3" euler="20 10 0"><joint name="turn" axis="0 0 1"/><geom size="0.1" pos="0.1 0 0"/>
      <body name="arm" pos="0.3 0 0" euler="0 0 30"><joint name="lift" axis="0 1 0"/><geom size="0.05" pos="0.1 0.1 0"/>
      </body></body>
  </worldbody>
  <actuator>
    <position name="turn" joint="turn" kp="10" gear="2"/>
    <general name="lift" joint="lift" gainprm="3" biastype="affine" biasprm="0.4 -5 -1" dyntype="filter" dynprm="0.1"
      delay="0.01" nsample="3"/>
    <motor name="motor" joint="turn"/>
  </actuator>
</mujoco>
"""
OLD_GAINED = GAINED.replace('\n      delay="0.01" nsample="3"', "")


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


def build() -> mujoco.MjModel:
    """Return the model, without delays where MuJoCo does not know them."""
    try:
        return mujoco.MjModel.from_xml_string(GAINED)
    except ValueError:
        return mujoco.MjModel.from_xml_string(OLD_GAINED)


def perturbed(mjm: mujoco.MjModel, seed: int) -> mujoco.MjModel:
    """Return a copy of a model with gains of its own."""
    rng, mjm = np.random.default_rng(seed), copy.copy(mjm)
    for name in GAINS:
        array = getattr(mjm, name)
        array += rng.uniform(0.1, 0.4, array.shape) * (np.abs(array) + 0.01)
    return mjm


def test_controls_follow_gains_where_they_held_the_pose():
    """No force at the present pose afterwards; a control that somebody else has set stays, and so do other worlds."""
    mjm = build()
    models = [perturbed(mjm, seed) for seed in range(NWORLD)]
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, NWORLD)
        qpos = np.random.default_rng(0).uniform(-1.0, 1.0, (NWORLD, 2)).astype(np.float32)
        d.qpos.assign(qpos)
        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        rest.law = wp.array(np.repeat(rest.law.numpy(), NWORLD, axis=0), dtype=wp.vec2, ndim=2)
        everywhere = wp.ones(NWORLD, dtype=wp.bool)
        held = np.stack([qpos[:, 0] * 2.0, (5.0 * qpos[:, 1] - 0.4) / 3.0, 0.0 * qpos[:, 0]], axis=1)
        d.ctrl.assign(held)
        d.act.assign(held[:, 1:2])
        launch_holding(rest, m, d, everywhere)
        np.testing.assert_allclose(d.ctrl.numpy(), held, atol=1e-6)
        for name in GAINS:
            array, rows = getattr(m, name), np.stack([getattr(each, name) for each in models])
            setattr(m, name, wp.array(rows, dtype=array.dtype))
        d.ctrl.numpy()[2, 0] = 7.0
        before = d.ctrl.numpy().copy()
        launch_holding(rest, m, d, wp.array(MASK, dtype=wp.bool))
    ctrl, act = d.ctrl.numpy(), d.act.numpy()
    np.testing.assert_array_equal(ctrl[~MASK], before[~MASK])
    assert ctrl[2, 0] == 7.0
    for world in np.flatnonzero(MASK):
        data = mujoco.MjData(models[world])
        data.qpos[:], data.ctrl[:], data.act[:] = qpos[world], ctrl[world], act[world]
        mujoco.mj_forward(models[world], data)
        assert abs(data.actuator("lift").force[0]) < 1e-5
        if world != 2:
            assert abs(data.actuator("turn").force[0]) < 1e-5


def test_controls_close_the_gripper_and_hold_the_arm():
    """The travel of a finger is the gripper's control, and angles are those of the joints."""
    data, layouts = reset_worlds(starting(), 40)
    qpos, ctrl, kinds = data.qpos.numpy(), data.ctrl.numpy(), layouts.start.numpy()
    closed = np.isin(kinds, CLOSED)
    assert (ctrl[closed, 7] == 0.0).all()
    np.testing.assert_allclose(ctrl[~closed, 7], qpos[~closed, 7], atol=1e-7)
    np.testing.assert_allclose(ctrl[:, :7], qpos[:, :7], atol=1e-6)


def test_controls_do_not_close_a_gripper_that_would_squeeze_a_thing_out(tmp_path):
    """MuJoCo C keeps a box that is soft on one side in place with these controls, but not with closed fingers."""
    half = '<geom type="box" size=".01 .02 .015" pos="{} 0 0" density="600" priority="2" solref="{} 1"/>'
    text = half.format(0.01, 0.035) + half.format(-0.01, 0.01)
    (tmp_path / "box.xml").write_text(f'<mujoco><worldbody><body name="box">{text}</body></worldbody></mujoco>')
    block = SCENE["objects"]["block"] | {"asset": str(tmp_path / "box.xml")}
    grasp = {"robot": "grasp", "of": "block", "grasp": "top 90"}
    scene = {**SCENE, "objects": {"block": block}, "start": [grasp, {**grasp, "lift": LIFT}], "bank": 1}
    compiled = compile_scene(scene, "cpu")
    data, layouts = reset_worlds(compiled, 10)
    assert all(row.fingers == 2 and row.drift < 1e-3 for row in stepped(compiled, data, layouts))
    ctrl, there = data.ctrl.numpy(), data.qpos.numpy()[:, 7]
    assert ((ctrl[:, 7] > 0.0) & (ctrl[:, 7] < there)).all()
    ctrl[:, 7] = 0.0
    data.ctrl.assign(ctrl)
    assert all(row.drift > 1e-3 for row in stepped(compiled, data, layouts))


def test_stored_layouts_have_the_controls_of_their_starts():
    """Those of the row of each world, and none for bare states."""
    compiled, table = starting(), make_table(starting(), 60, 4)
    model, data = make_worlds(compiled, 3)
    randomizer = ResetRandomizer(compiled, model, data)
    held, free = (int(np.flatnonzero(np.isin(table.start, CLOSED) == wanted)[0]) for wanted in (True, False))
    randomizer.write(table, np.array([held, free, -1]))
    assert data.ctrl.numpy()[0, 7] == 0.0
    np.testing.assert_allclose(data.ctrl.numpy()[1, 7], table.qpos[free, 7], atol=1e-7)


@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_a_motor_squeezes_as_hard_as_holds(tmp_path, gear: float):
    """Its control is the end that closes, or 1/2, 1/4 or 1/8 of it. MuJoCo C holds the block, and drops it without."""
    folder = files("sceniris_gym.assets")
    motor = f'<motor name="gripper" tendon="gripper" gear="{gear}" ctrlrange="-60 80"/>'
    text = re.sub('<position name="gripper".*/>', motor, (folder / "panda.xml").read_text())
    (tmp_path / "panda.xml").write_text(text.replace('meshdir="', f'meshdir="{folder}/'))
    robot = {**SCENE["robot"], "asset": str(tmp_path / "panda.xml")}
    grasp = {"robot": "grasp", "of": "block"}
    objects = {"block": {**SCENE["objects"]["block"], "reachable": "ik"}}
    scene = {**SCENE, "robot": robot, "objects": objects, "start": [{**grasp, "lift": LIFT}, {}], "bank": 1}
    compiled = compile_scene(scene, "cpu")
    data, layouts = reset_worlds(compiled, 10)
    kinds, ctrl = layouts.start.numpy(), data.ctrl.numpy()
    assert set(ctrl[kinds == 0, 7] / (-60.0 if gear > 0.0 else 80.0)) <= set(PRESSES)
    np.testing.assert_allclose(ctrl[kinds == 1, 7], compiled.scene.home_ctrl[7])
    assert all(row.fingers == 2 and row.drift < 1e-3 for row in stepped(compiled, data, layouts))
    ctrl[:, 7] = 0.0
    data.ctrl.assign(ctrl)
    assert all(row.drift > 1e-2 for row in stepped(compiled, data, layouts))


def test_a_gripper_without_a_position_actuator_or_a_motor_is_refused():
    """By the name of its robot, before anything falls."""
    scene = {**SCENE, "start": SCENE["start"][:2], "bank": 1}
    compiled = compile_scene({**scene, "start": [{"robot": "grasp", "of": "block"}]}, "cpu")
    mjm = compiled.mjm
    data = mjw.make_data(mjm, nworld=1, nconmax=64, njmax=256)
    gain = mjm.actuator_biasprm[7].copy()
    mjm.actuator_biasprm[7] = mjm.actuator_ctrllimited[7] = 0.0
    try:
        with pytest.raises(NotSupportedError, match="gripper of 'robot' has no position actuator"):
            ResetRandomizer(compiled, make_worlds(compiled, 1)[0], data)
    finally:
        mjm.actuator_biasprm[7], mjm.actuator_ctrllimited[7] = gain, 1


@pytest.fixture(scope="module")
def weighed(tmp_path_factory) -> ResetRandomizer:
    """Return worlds whose arm has weight: hinges, a slide, gears, a tendon, an activation, and limits of forces.

    Masses, gravity and gains are drawn, and `gravcomp` bears part of the weight.
    """
    text = mjcf({"base": ("mimic", "0.1 0 0", 30.0)}).replace('gravity="0 0 0"', 'gravity="2 -3 -8"')
    path = tmp_path_factory.mktemp("weight") / "arm.xml"
    path.write_text(text.replace('<body name="base:quill"', '<body name="base:quill" gravcomp=".4"'))
    draws = {"mass": {"scale": [0.5, 2.0]}, "gains": {"scale": [0.8, 1.2]}}
    robot = {"in_model": "base", "tcp": "base:point", "joints": {"base:run": {"noise": 0.1}}, "randomize": draws}
    gravity = {"gravity": {"add": [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]}}
    compiled = compile_scene({"model": str(path), "robot": robot, "randomize": gravity, "bank": 1}, "cpu")
    model, data = make_worlds(compiled, NWORLD, fields=("actuator_forcerange",))
    return ResetRandomizer(compiled, model, data)


def in_mujoco(randomizer: ResetRandomizer, world: int) -> mujoco.MjData:
    """Return a world's state in MuJoCo C, in a model with the world's draws, after mj_forward."""
    mjm, m, d = copy.copy(randomizer.compiled.mjm), randomizer.model, randomizer.data
    for name in (*GAINS, "body_mass", "actuator_forcerange"):
        rows = getattr(m, name).numpy()
        getattr(mjm, name)[:] = rows[world % len(rows)].reshape(getattr(mjm, name).shape)
    mjm.opt.gravity[:] = m.opt.gravity.numpy()[world]
    data = mujoco.MjData(mjm)
    for name in ("qpos", "qvel", "ctrl", "act"):
        getattr(data, name)[:] = getattr(d, name).numpy()[world]
    mujoco.mj_forward(mjm, data)
    return data


def test_controls_bear_the_weight_of_an_arm(weighed):
    """In each world with its masses, gravity and gains, and again after a task has changed them."""
    dofs = [weighed.compiled.mjm.joint(f"base:{name}").dofadr[0] for name in ("swing", "1", "run", "turn about")]
    for change in ((), ("body_mass", "actuator_gainprm")):
        weighed.reset(MASK)
        weighed.reset(~MASK)
        for name in change:
            weighed.scale_field(name, "robot", np.linspace(0.7, 1.5, NWORLD, dtype=np.float32))
        if change:
            weighed.refresh()
        for world in np.flatnonzero(~MASK) if change else range(NWORLD):
            data = in_mujoco(weighed, int(world))
            assert (np.abs(data.qfrc_bias[dofs][:3]) > 0.05).all()
            np.testing.assert_allclose((data.qfrc_actuator + data.qfrc_passive - data.qfrc_bias)[dofs], 0.0, atol=1e-3)
            before = data.site("base:point").xpos.copy()
            mujoco.mj_step(data.model, data, 100)
            assert np.linalg.norm(data.site("base:point").xpos - before) < 2e-4


def test_controls_bear_no_more_than_actuators_can(weighed):
    """With a lower limit of forces, the control asks for the limit, so that the arm can leave it at once."""
    mjm = weighed.compiled.mjm
    actuator, joint = mjm.actuator("base:gamma").id, mjm.joint("base:run")
    forces = weighed.model_field("actuator_forcerange")
    limits = forces.clone()
    try:
        forces[:, actuator] = forces.new_tensor([-0.5, 0.5])
        weighed.reset()
        for world in range(NWORLD):
            data = in_mujoco(weighed, world)
            assert abs(data.qfrc_bias[joint.dofadr[0]]) > 3.0 * 0.5
            asked = data.ctrl[actuator] - data.actuator_length[actuator]
            np.testing.assert_allclose(abs(asked) * data.model.actuator_gainprm[actuator, 0], 0.5, rtol=1e-3)
    finally:
        forces.copy_(limits)

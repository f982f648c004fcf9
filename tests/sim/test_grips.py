"""Controls at the start: fingers around a thing are asked to close, all others hold what the layout says."""

from __future__ import annotations

import mujoco_warp as mjw
import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.sim.batch import default_budget
from sceniris_gym.sim.model_fields import put_model
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.starting import HANDLE, HELD, LIFTED, SCENE, STANDING, reset_worlds, starting

CLOSED = (STANDING, LIFTED, HELD, HANDLE)


def test_controls_close_the_gripper_and_hold_the_arm():
    """The travel of a finger is the gripper's control, and angles are those of the joints."""
    data, layouts = reset_worlds(starting(), 40)
    qpos, ctrl, kinds = data.qpos.numpy(), data.ctrl.numpy(), layouts.start.numpy()
    closed = np.isin(kinds, CLOSED)
    assert (ctrl[closed, 7] == 0.0).all()
    np.testing.assert_allclose(ctrl[~closed, 7], qpos[~closed, 7], atol=1e-7)
    np.testing.assert_allclose(ctrl[:, :7], qpos[:, :7], atol=1e-6)


def test_stored_layouts_have_the_controls_of_their_starts():
    """Those of the row of each world, and none for bare states."""
    compiled, table = starting(), make_table(starting(), 60, 4)
    nconmax, njmax = default_budget(compiled.mjm)[:2]
    data = mjw.make_data(compiled.mjm, nworld=3, nconmax=nconmax, njmax=njmax)
    randomizer = ResetRandomizer(compiled, put_model(compiled, 3), data)
    held, free = (int(np.flatnonzero(np.isin(table.start, CLOSED) == wanted)[0]) for wanted in (True, False))
    randomizer.write(table, np.array([held, free, -1]))
    assert data.ctrl.numpy()[0, 7] == 0.0
    np.testing.assert_allclose(data.ctrl.numpy()[1, 7], table.qpos[free, 7], atol=1e-7)


def test_a_gripper_without_a_position_actuator_is_refused():
    """By the name of its robot, before anything falls."""
    scene = {**SCENE, "start": SCENE["start"][:2], "bank": 1}
    compiled = compile_scene({**scene, "start": [{"robot": "grasp", "of": "block"}]}, "cpu")
    mjm = compiled.mjm
    data = mjw.make_data(mjm, nworld=1, nconmax=64, njmax=256)
    gain = mjm.actuator_biasprm[7].copy()
    mjm.actuator_biasprm[7] = 0.0
    try:
        with pytest.raises(NotSupportedError, match="gripper of 'robot' has no position actuator"):
            ResetRandomizer(compiled, put_model(compiled, 1), data)
    finally:
        mjm.actuator_biasprm[7] = gain

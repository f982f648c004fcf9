"""Kinds of starts as flat arrays: shares, intervals that are upside down for none, and bounds of a sound layout."""

from __future__ import annotations

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.pack.starts import pack_starts
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.starting import HANDLE, HELD, HOME, LIFT, LIFTED, SCENE


def test_kinds_are_packed_one_a_row():
    """Weights add up to 1, and bounds hold all joints of all starts."""
    plan = build_plan(build_model(SceneConfig.load(SCENE)))
    bounds = np.zeros(plan.scene.mjm.nq)
    starts = pack_starts(plan, bounds, "cpu")
    assert starts is not None
    assert starts.weight.numpy().tolist() == [3, 1, 1, 1, 2, 1, 1]
    np.testing.assert_allclose(starts.lift.numpy()[LIFTED], LIFT)
    low, high = np.moveaxis(starts.arm_range.numpy(), 2, 0)
    assert (low[HOME] > high[HOME]).all()
    assert (low[HELD, :7] < high[HELD, :7]).all()
    drawn = starts.draw_range.numpy()
    assert (drawn[:, :, 0] <= drawn[:, :, 1]).sum(axis=1).tolist() == [int(i == HANDLE) for i in range(7)]
    mjm = plan.scene.mjm
    for name in [*(f"panda/joint{i}" for i in range(1, 8)), "panda/finger_joint1", "cabinet/upper"]:
        joint = mjm.joint(name)
        assert bounds[joint.qposadr[0]] >= np.abs(joint.range).max() - 1e-9


def test_a_scene_without_the_word_has_none():
    """Its layouts begin in the start pose."""
    config = SceneConfig.load({key: value for key, value in SCENE.items() if key != "start"})
    plan = build_plan(build_model(config))
    assert pack_starts(plan, np.zeros(plan.scene.mjm.nq), "cpu") is None

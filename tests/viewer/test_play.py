"""Physics from a layout: what MuJoCo C makes of it, at the speed that is asked for."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.viewer.play import Player
from tests.viewer.worlds_on_show import world_of


@pytest.fixture
def player() -> Player:
    """A player of a scene with an arm."""
    world = world_of("tabletop_lift")
    return Player(world.compiled, world.table)


def test_it_begins_with_the_layout_and_comes_back_to_it(player: Player):
    """Positions are those of the table, time is zero, after a while of physics as well."""
    before = player.data.qpos.copy()
    assert before == pytest.approx(player.table.qpos[0])
    player.running = True
    assert player.advance(0.05)
    assert player.data.time == pytest.approx(0.05)
    player.reset()
    assert player.data.time == 0.0
    np.testing.assert_array_equal(player.data.qpos, before)


def test_time_goes_on_as_fast_as_it_is_asked_for_and_no_faster(player: Player):
    """Half the speed is half the time; a long wait is not made up for; what is paused stands still."""
    assert not player.advance(1.0)
    player.running, player.speed = True, 0.5
    for _ in range(10):
        player.advance(0.02)
    assert player.data.time == pytest.approx(0.1, abs=0.006)
    player.advance(30.0)
    assert player.data.time < 0.21
    player.step()
    assert player.data.time < 0.22


def test_the_arm_holds_its_pose_and_follows_its_targets(player: Player):
    """Without a new target joints stay; with one they move there."""
    adr = player.mjm.joint("panda/joint1").qposadr[0]
    start = player.data.qpos[adr]
    player.running = True
    for _ in range(10):
        player.advance(0.05)
    assert player.data.qpos[adr] == pytest.approx(start, abs=0.02)
    names = [name for name, _, _ in player.target_ranges()]
    joint = player.mjm.joint("panda/joint1").id
    first = next(i for i in range(player.mjm.nu) if player.mjm.actuator_trnid[i, 0] == joint)
    player.data.ctrl[first] = start + 0.4
    for _ in range(20):
        player.advance(0.05)
    assert player.data.qpos[adr] == pytest.approx(start + 0.4, abs=0.05)
    assert len(names) == player.mjm.nu


def test_targets_have_ranges_also_where_controls_have_no_limits():
    """Those of the joint, or +-1."""
    joint = '<joint name="hinge" axis="0 0 1" range="-0.5 0.5" limited="true"/>'
    motors = '<position joint="hinge" kp="1" ctrllimited="false"/><motor site="tip" name="push"/>'
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><worldbody><body>{joint}<geom size="0.1"/><site name="tip"/></body>'
        f"</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    world = world_of("mid")
    player = Player(world.compiled, world.table)
    player.mjm = mjm
    (first, low, high), (second, *ends) = player.target_ranges()
    assert (low, high) == pytest.approx((-0.5, 0.5))
    assert (first, second, ends) == ("actuator 0", "push", [-1.0, 1.0])


def test_what_an_episode_begins_with_in_the_hand_stays_there():
    """Fingers close on it, as in a reset, again after going back to the layout; the arm holds its pose."""
    lifted = {"robot": "grasp", "of": "can", "lift": [0.05, 0.1]}
    world = world_of({"base": "tabletop_lift", "bank": 2, "start": [lifted]})
    player = Player(world.compiled, world.table)
    can, site = player.mjm.body("can").id, player.mjm.site(world.compiled.scene.tcps["robot"]).id
    for _ in range(2):
        np.testing.assert_allclose(player.data.qpos, world.table.qpos[0], atol=1e-7)
        before = player.data.xpos[can] - player.data.site_xpos[site]
        for _ in range(round(0.5 / player.mjm.opt.timestep)):
            player.step()
        assert np.linalg.norm(player.data.xpos[can] - player.data.site_xpos[site] - before) < 2e-3
        player.reset()

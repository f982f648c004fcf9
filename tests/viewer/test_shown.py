"""One world as layers see it: who is there, where, and who is parked; and what physics makes of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.viewer.layers import sketch_relations
from sceniris_gym.viewer.shown import Player, ShownWorld, target_ranges
from tests.viewer.worlds_on_show import world_of

GROUPED = {
    "floor": {"size": [1.0, 1.0]},
    "objects": {name: {"asset": name, "on": "floor"} for name in ("apple", "pear", "can")},
    "groups": {"fruit": {"of": ["apple", "pear", "can"], "count": 1}},
}


@pytest.mark.parametrize("scene", ["hard_plus", "tabletop_lift", "clutter_push"])
def test_a_state_alone_says_where_objects_stand(scene: str):
    """Pivots, headings and bounds are those that the generator has for the same layout."""
    world = world_of(scene, 4)
    alone = ShownWorld(world.compiled, world.table)
    for name in world.placed_names:
        (place, bounds), (known, known_bounds) = alone.standing(name), world.standing(name)
        assert place[:3] == pytest.approx(known[:3], abs=1e-4)
        assert np.cos(place[3] - known[3]) == pytest.approx(1.0, abs=1e-5)
        assert bounds == pytest.approx(known_bounds, abs=2e-3)


def test_absent_objects_are_hidden_and_can_be_shown_before_the_scene():
    """Two of three; their offsets bring them from where they are parked to beside the floor."""
    world = world_of(GROUPED)
    assert len(world.absent) == 2
    assert len(world.placed_names) == 1
    bodies = {world.compiled.scene.bodies[name] for name in world.absent}
    assert set(world.hidden_bodies()) == bodies
    assert world.hidden_bodies(with_absent=False) == []
    low = np.array([-0.5, -0.5, 0.0])
    offsets = world.parked_offsets(low)
    assert set(offsets) == bodies
    for body, offset in offsets.items():
        moved = world.data.xpos[body] + offset
        assert np.all(np.abs(moved[:2]) < 1.0)
        assert moved[1] < -0.5


def test_what_has_no_place_yet_is_not_shown():
    """It is hidden, and no layer is about it."""
    world = world_of("mid")
    early = ShownWorld(world.compiled, world.table, frozenset({"banana"}))
    assert not early.is_shown("banana")
    assert early.placed_names == ["cabinet", "apple"]
    assert early.hidden_bodies() == world.compiled.scene.subtree("banana")


def test_an_object_is_the_variant_that_is_there():
    """Its name stands for that variant, and the generator's own pivot is the one of the state."""
    things = {"asset": ["apple", "can", "pear"], "on": "floor", "region": {"box": [[-0.2, -0.2], [0.2, 0.2]]}}
    near = [{"near": "thing", "distance": {"max": 0.3}}]
    objects = {"thing": things, "mug": {"asset": "mug", "on": "floor", "relations": near}}
    world = world_of({"floor": {"size": [1.0, 1.0]}, "objects": objects}, 3)
    own = world.own("thing")
    assert world.placed_names == [own, "mug"]
    assert world.is_shown("thing")
    alone = ShownWorld(world.compiled, world.table)
    for name in (own, "thing"):
        assert alone.standing(name)[0][:3] == pytest.approx(world.standing(own)[0][:3], abs=1e-4)
    assert len(sketch_relations(world, "mug").surfaces) == 1
    assert world.box("thing")[0] == pytest.approx(world.box(own)[0])


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
    """A long wait is not made up for; what is paused stands still."""
    assert not player.advance(1.0)
    player.running = True
    for _ in range(10):
        player.advance(0.01)
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
    names = [name for name, _, _ in target_ranges(player.mjm)]
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
    (first, low, high), (second, *ends) = target_ranges(mjm)
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

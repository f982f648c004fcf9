"""The search that judges paths finds its way through a slit, and none through a wall; its arm collides as it should."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np

from tests.oracle.rrt_connect import Arm, connect

LOW, HIGH = np.full(2, -1.0), np.full(2, 1.0)
START, GOALS = np.array([-0.8, -0.8]), np.array([[0.8, -0.8], [0.9, 0.9]])


def through(slit: float):
    """Return a test of pieces in a square with a wall at x = 0 that has a slit at its upper end."""

    def edge(a: np.ndarray, b: np.ndarray) -> bool:
        points = a + np.linspace(0.0, 1.0, 60)[:, None] * (b - a)
        return not ((np.abs(points[:, 0]) < 0.05) & (points[:, 1] < 1.0 - slit)).any()

    return edge


def test_a_way_leads_through_a_slit_to_one_of_the_goals():
    """All pieces of it are free."""
    way = connect(START, GOALS, through(0.2), LOW, HIGH, 5.0)
    assert way is not None
    np.testing.assert_array_equal(way[0], START)
    assert (way[-1] == GOALS).all(axis=1).any()
    assert all(through(0.2)(a, b) for a, b in itertools.pairwise(way))


def test_no_way_leads_through_a_wall():
    """The time ends the search."""
    assert connect(START, GOALS, through(0.0), LOW, HIGH, 0.1) is None


def test_an_arm_is_free_up_to_its_margin_and_finds_its_joints():
    """Two slides and a ball before a block; the ball may touch the target alone."""
    ball = '<geom size=".05"/><site name="tcp"/>'
    slides = '<joint type="slide" axis="1 0 0" range="-1 1"/><joint type="slide" axis="0 1 0" range="-1 1"/>'
    block = '<body name="block" pos=".5 0 0"><geom type="box" size=".1 .1 .1"/></body>'
    arm = f'<body name="arm"><body name="hand">{slides}{ball}</body></body>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{arm}{block}</worldbody></mujoco>")
    mocap = np.zeros((0, 3)), np.zeros((0, 4))
    hand, target = [mjm.body("hand").id], [mjm.body("block").id]
    one = Arm(mjm, np.zeros(2), mocap, np.zeros(2), hand, hand, target, np.array([0, 1]), mjm.site("tcp").id)
    near = np.array([0.348, 0.0])  # 2 mm from the block
    assert one.is_free(near, 0.001)
    assert not one.is_free(near, 0.003)
    assert one.is_free(near + 0.1, 0.003, 0.0005)  # inside of the target
    assert not one.edge(np.zeros(2), np.array([1.0, 0.0]), 0.0)
    found = one.solve(np.array([0.2, -0.3, 0.0]), np.eye(3), np.zeros(2))
    assert found is not None
    np.testing.assert_allclose(found, [0.2, -0.3], atol=5e-4)

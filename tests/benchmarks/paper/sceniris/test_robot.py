"""`robot_position`: one is where the robot stands, several are bounds of it; it is never dropped without a word."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from benchmarks.paper.sceniris.keys import KeysLeftOutWarning
from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym import compile_scene
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.tables import make_table
from tests.benchmarks.paper.sceniris.configurations import mug, read

AT = [-0.6, 0.1, 0.0]


def placed(position: Any, **robot: Any) -> tuple[tuple, str]:
    """The robot's base, and what is told."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        config = read_sceniris(mug() | {"env": {"robot_position": position}}, robot={"asset": "panda", **robot})
    assert config.robot is not None
    return config.robot.base, "".join(str(warning.message) for warning in caught)


@pytest.mark.parametrize("position", [AT, np.array(AT), [AT], [AT, AT]])
def test_a_position_is_where_the_robot_stands(position: Any):
    """Alone, or alone in a list; nothing needs to be told."""
    assert placed(position) == (tuple(AT), "")


def test_within_several_positions_on_the_floor_the_base_is_drawn():
    """Everywhere between the least and the greatest, beyond the workspace too, and turned as said; without a word."""
    cfg = mug() | {"env": {"env_size": 1.0, "robot_position": [[-0.9, 0.1, 0.0], [-0.6, 0.5, 0.0], [-0.7, -0.2, 0.0]]}}
    config, left_out = read(cfg, robot={"asset": "panda", "yaw": 90.0})
    assert left_out == []
    compiled = compile_scene(config, "cpu")
    table = make_table(compiled, 256, 0)
    mocap = int(compiled.mjm.body("panda").mocapid[0])
    at = table.mocap_pos[:, mocap]
    assert table.valid.all()
    assert np.allclose(at.min(axis=0)[:2], [-0.9, -0.2], atol=0.02) and np.allclose(
        at.max(axis=0)[:2], [-0.6, 0.5], atol=0.02
    )
    assert (at[:, 2] < 0.002).all()
    assert np.allclose(np.abs(table.mocap_quat[:, mocap]), [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-6)
    line = read(mug() | {"env": {"robot_position": [[-0.6, 0.1, 0.0], [-0.6, 0.3, 0.0]]}}, robot="panda")[0]
    assert line.robot is not None and line.robot.region is not None
    assert np.allclose(line.robot.region.box or 0.0, [[-0.6, 0.1], [-0.6, 0.3]], atol=2e-4)
    with pytest.raises(SceneKeyError, match=r"env\.robot_position: should be within 100 m"):
        read(mug() | {"env": {"robot_position": [[0.0, 0.0, 0.0], [0.0, 101.0, 0.0]]}}, robot="panda")


def test_several_positions_above_the_floor_are_bounds_and_their_middle_is_told():
    """By the key, and where the robot stands then."""
    base, told = placed([[-0.8, 0.0, 0.0], [-0.4, 0.3, 0.0], [-0.5, 0.1, 0.2]])
    assert base == pytest.approx((-0.6, 0.15, 0.1))
    assert "env.robot_position" in told
    assert "the middle of its bounds" in told


def test_a_base_that_is_given_wins():
    """Without a word where it agrees, which within bounds it does."""
    assert placed(AT, base=AT) == (tuple(AT), "")
    assert placed([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], base=AT) == (tuple(AT), "")
    base, told = placed([0.0, 0.0, 0.0], base=AT)
    assert base == tuple(AT)
    assert "env.robot_position" in told and "'base' that it was given" in told


def test_without_a_robot_it_is_told_what_would_help():
    """The key is named, as for a robot that is in the model."""
    cfg = mug() | {"env": {"robot_position": AT}}
    config, left_out = read(cfg)
    assert (config.robot, left_out) == (None, ["env.robot_position"])
    with pytest.warns(KeysLeftOutWarning, match="'robot_position' is carried over if read_sceniris gets a 'robot'"):
        read_sceniris(cfg)


def test_a_base_that_is_drawn_stays_drawn():
    """And the position is told not to hold."""
    region = {"box": [[-1.0, -1.0], [1.0, 1.0]]}
    cfg = mug() | {"env": {"robot_position": AT}}
    with pytest.warns(KeysLeftOutWarning, match=r"env\.robot_position \(the base of the robot is drawn"):
        config = read_sceniris(cfg, robot={"asset": "panda", "on": "floor", "region": region})
    assert config.robot is not None and config.robot.placing is not None
    assert "base" not in config.robot.model_fields_set


@pytest.mark.parametrize("position", [[0.0, 1.0], "here", [[0.0, 1.0, 2.0], [1.0]], [], [[]], [0.0, np.nan, 1.0], 3])
def test_what_is_no_position_is_refused(position: Any):
    """By its key."""
    with pytest.raises(SceneKeyError, match=r"env\.robot_position: .* should be a position \[x, y, z\]"):
        read_sceniris(mug() | {"env": {"robot_position": position}}, robot="panda")


@pytest.mark.parametrize("in_scene", [True, False])
def test_reach_is_from_there(in_scene: bool):
    """Reachable objects stay within the arm's reach of its base, which the world's origin would not allow.

    Without a robot in the scene there are none of its joints and geoms either.
    """
    cfg: dict = mug(reachable=True) | {"env": {"env_size": 3.0, "robot_position": [1.2, 1.0, 0.0]}}
    config = read_sceniris(cfg, robot={"asset": "panda", "in_scene": in_scene})
    assert config.robot is not None and config.robot.base == (1.2, 1.0, 0.0)
    compiled = compile_scene(config, "cpu")
    assert ("panda/joint1" in {compiled.mjm.joint(j).name for j in range(compiled.mjm.njnt)}) == in_scene
    adr = int(compiled.mjm.joint(int(compiled.mjm.body("mug").jntadr[0])).qposadr[0])
    table = make_table(compiled, 64, 0)
    apart = np.linalg.norm(table.qpos[:, adr : adr + 2] - [1.2, 1.0], axis=1)
    assert table.valid.all()
    assert apart.max() < 0.9

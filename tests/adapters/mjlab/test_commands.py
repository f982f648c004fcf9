"""mjlab's command that redraws entities on a timer: they are free where they go, and all else stays."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError

pytest.importorskip("mjlab", reason="needs mjlab: make test-mjlab")
from mjlab.envs import ManagerBasedRlEnv

from sceniris_gym.adapters.mjlab import RedrawObjectsCfg
from tests.adapters.mjlab.test_terms import NUM_ENVS, cubes_on, deepest, local, plain_cfg


def make() -> ManagerBasedRlEnv:
    """Return an environment with two cubes, one of which is redrawn every three steps."""
    cfg = plain_cfg(cubes_on())
    cfg.decimation, period = 1, 3 * cfg.sim.mujoco.timestep
    # pyrefly: ignore[unexpected-keyword]
    cfg.commands["redraw"] = RedrawObjectsCfg(objects=("cube_1",), resampling_time_range=(period, period))
    return ManagerBasedRlEnv(cfg, "cpu")


def test_a_cube_is_elsewhere_whenever_the_timer_runs_out():
    """At its origin, in its region, free of the other cube, which stays to the bit; a reset begins the count anew."""
    env = make()
    env.reset()
    command, action = env.command_manager.get_term("redraw"), torch.zeros(NUM_ENVS, env.action_manager.total_action_dim)
    places = [local(env, "cube_1")]
    for step in range(1, 8):
        *_, extras = env.step(action)
        places.append(local(env, "cube_1"))
        moved = np.linalg.norm(places[-1] - places[-2], axis=1) > 0.01
        assert moved.all() if step % 3 == 0 else not moved.any()
        assert command.command.flatten().tolist() == [step // 3] * NUM_ENVS
        assert deepest(env) < 1e-3  # cubes sink into the ground as they land
    assert extras["layout"]["redraws"].tolist() == [2] * NUM_ENVS  # pyrefly: ignore[unbound-name]
    assert not extras["layout"]["redraw_failed"].any()
    assert ((places[6][:, :2] >= [0.25, -0.15]) & (places[6][:, :2] <= [0.40, 0.15])).all()
    np.testing.assert_allclose(env.scene["cube_1"].data.root_link_pos_w[:, 2], env.sim.data.qpos[:, 9], atol=1e-3)
    env.reset(env_ids=torch.tensor([0, 2]))
    assert command.command.flatten().tolist() == [0, 2, 0, 2, 2, 2]


def test_the_command_needs_the_event_that_places_the_objects():
    """Its scene says where they may be."""
    cfg = plain_cfg(cubes_on())
    del cfg.events["layouts"]
    # pyrefly: ignore[unexpected-keyword]
    cfg.commands["redraw"] = RedrawObjectsCfg(objects=("cube_1",), resampling_time_range=(1.0, 1.0))
    with pytest.raises(ArgumentError, match="PlaceLayoutsCfg"):
        ManagerBasedRlEnv(cfg, "cpu")

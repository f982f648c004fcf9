"""Kinds of starts while placing: their shares, joints that they draw otherwise, and things at their markers."""

from __future__ import annotations

import numpy as np
from scipy import stats

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.layout.wave.start_kinds import launch_draw_kinds
from tests.layout.starting import HANDLE, PLACED, SCENE, starting


def test_kinds_are_as_frequent_as_their_weights():
    """A million episodes, of which nothing but the kind is drawn, in either split."""
    weights = np.array([kind.get("weight", 1.0) for kind in SCENE["start"]])
    drawn = []
    for split in ("train", "eval"):
        generator = LayoutGenerator(starting(), 500, seed=3, split=split)
        found = np.zeros(len(weights))
        view = generator.layouts.view
        view.pending_seed.assign(np.arange(500, dtype=np.uint64))
        for episode in range(1000):
            view.pending_episode.fill_(episode)
            launch_draw_kinds(generator._work, None)
            found += np.bincount(view.start.numpy(), minlength=len(weights))
        assert stats.chisquare(found, found.sum() * weights / weights.sum()).pvalue > 0.001
        drawn.append(view.start.numpy().copy())
    assert (drawn[0] != drawn[1]).any()


def test_a_kind_draws_joints_from_its_own_interval():
    """The drawer is open where its handle is held, and closed otherwise."""
    compiled, table = starting(), make_table(starting(), 300, 0)
    joint = compiled.mjm.joint("cabinet/upper")
    share = table.qpos[:, joint.qposadr[0]] / joint.range[1]
    opened = table.start == HANDLE
    assert (share[~opened] == 0.0).all()
    assert share[opened].min() >= 0.8
    assert share[opened].max() <= 1.0
    assert np.ptp(share[opened]) > 0.1


def test_a_thing_is_at_its_marker():
    """If the kind says so; it is in its own region otherwise."""
    compiled, table = starting(), make_table(starting(), 300, 0)
    adr = compiled.mjm.joint("apple/free").qposadr[0]
    goal = compiled.mjm.body("goal").mocapid[0]
    away = np.linalg.norm(table.qpos[:, adr : adr + 2] - table.mocap_pos[:, goal, :2], axis=1)
    assert away[table.start == PLACED].max() < 0.02  # the apple's pivot is not its origin
    assert away[table.start != PLACED].min() > 0.1
    assert np.ptp(table.qpos[:, adr + 2]) < 5e-3

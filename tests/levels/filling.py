"""Buffers with levels in them, and what worlds choose of these."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.layout.layouts import view_of
from sceniris_gym.levels.buffer import Buffer, Episodes, create_buffer, launch_choose, launch_forget, launch_update
from sceniris_gym.levels.curriculum import LevelReplay
from sceniris_gym.levels.refresh import launch_refresh

NWORLD = 500


def created(replay: LevelReplay, nworld: int, nparam: int = 0) -> Buffer:
    """Return an empty buffer for a number of worlds."""
    params = {"next_param": np.zeros((nworld, nparam)), "default_param": np.zeros(nparam)}
    return create_buffer(replay, view_of(nworld, "cpu", {"next_episode": np.zeros(nworld), **params}))


def column(values: object, dtype: type) -> wp.array:
    """Return values on the CPU."""
    return wp.array(np.asarray(values), dtype=dtype, device="cpu")


def tell(buffer: Buffer, level: object, seed: object, outcome: object) -> None:
    """Update levels by the outcomes of episodes."""
    episodes = np.zeros(len(np.asarray(seed)))
    columns = column(level, int), column(seed, wp.uint64), column(episodes, int), column(outcome, float)
    launch_update(buffer, Episodes(*columns))


def filled(replay: LevelReplay, scores: np.ndarray) -> Buffer:
    """Return a buffer of one level for each score, with seeds 100, 101, ..."""
    buffer = created(replay, NWORLD)
    tell(buffer, np.full(len(scores), -1), 100 + np.arange(len(scores)), scores)
    launch_refresh(buffer, replay)
    return buffer


def chosen(buffer: Buffer, rounds: int) -> np.ndarray:
    """Return the levels that worlds are given, -1 for fresh ones, shape (rounds * nworld,)."""
    launch_forget(buffer, column(np.arange(NWORLD), wp.uint64), None)
    found = []
    for _ in range(rounds):
        launch_choose(buffer, None, 7, 1.0)
        found.append(buffer.next_level.numpy().copy())
    return np.concatenate(found)


SCORES = np.array([0.5, 0.02, 0.02, 3.0, 0.9, 0.0001, 1.7, 0.3])

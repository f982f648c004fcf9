"""Worlds of a task: their episodes, and the sources of their layouts."""

from __future__ import annotations

import numpy as np
import torch
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.pipeline import Chooser, LayoutPipeline
from sceniris_gym.program.compiled import CompiledScene
from tests.vector.stepping import actions


def test_truncation_counts_the_steps_of_each_world(make_env):
    """A world that ended early is truncated later than the others."""
    envs = make_env(2, max_episode_steps=3)
    envs.reset(seed=0)
    envs.step(actions(2, ending=(0,)))
    flags = [envs.step(actions(2))[3].tolist() for _ in range(3)]
    assert flags == [[False, False], [False, True], [True, False]]


def test_layouts_made_ahead_change_nothing(make_env):
    """Observations through ends of episodes, and after a reset of some worlds with new seeds."""
    seen = []
    for prefetch in (False, True):
        envs = make_env(3, max_episode_steps=2, sim_config={"prefetch": prefetch})
        assert (envs.randomizer.pipeline.ahead is not None) == prefetch
        found = [envs.reset(seed=3)[0]]
        for step in range(5):
            found.append(envs.step(torch.full((3, 5), 0.1))[0])
            if step == 2:
                mask = torch.tensor([True, False, True])
                found.append(envs.reset(seed=[9, 0, 4], options={"reset_mask": mask})[0])
        seen.append(found)
    for plain, ahead in zip(*seen, strict=True):
        assert all(torch.equal(plain[group], ahead[group]) for group in plain)


class Counting(Chooser):
    """Chooses for each world the episode of ten times the number of episodes that it has ended."""

    def __init__(self, layouts: Layouts) -> None:
        self.layouts, self.ended, self.success = layouts, np.zeros(layouts.nworld, int), []

    def launch_choose(self, mask: wp.array | None) -> None:
        """Choose for all worlds; those that are not masked have chosen the same before."""
        self.layouts.view.next_episode.assign(10 * self.ended)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Count."""
        self.ended += finished.numpy()
        self.success.append(success.numpy().tolist())


def test_a_chooser_of_ones_own_hears_how_episodes_end(make_env):
    """In each step; outcomes count from the next choice on, which is made when the next episode begins."""
    choosers: list[Counting] = []

    def source(compiled: CompiledScene, num_envs: int) -> LayoutPipeline:
        maker = LayoutGenerator(compiled, num_envs)
        choosers.append(Counting(maker.layouts))
        return LayoutPipeline(maker, chooser=choosers[0])

    envs = make_env(2, max_episode_steps=2, layout_source=source, sim_config={"graph": False})
    envs.reset(seed=0)
    episodes = []
    for _ in range(4):
        success = envs.step(actions(2, ending=(0,)))[4]["success"]
        assert choosers[0].success[-1] == success.float().tolist()
        episodes.append(envs.state.episode.tolist())
    assert choosers[0].ended.tolist() == [4, 2]
    assert episodes == [[0, 0], [10, 0], [20, 0], [30, 10]]

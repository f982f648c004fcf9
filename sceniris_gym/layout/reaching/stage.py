"""The reach stage of a reset, for the tiers `ik` and `clear`: find joints for a grasp of every reach target.

It follows placing. A world in which a target has no such joints continues with its next restart, or falls back on the
bank if it has none left. The stage plans no path from the start pose.
"""

from __future__ import annotations

from functools import partial

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.sequence import repeat_launches
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.hits import launch_test_arm
from sceniris_gym.layout.reaching.ik import launch_ik
from sceniris_gym.layout.reaching.poses import launch_pose_arm, launch_pose_hand
from sceniris_gym.layout.reaching.search import STARTS, ReachStep, create_reach_search
from sceniris_gym.layout.reaching.waves import launch_accept_grasps, launch_open_wave, launch_open_worlds
from sceniris_gym.layout.wave.search import Search, SearchSize
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.reach import Reaching


class ReachStage:
    """A search for joints of grasps in all waiting worlds, in waves of candidates.

    Args:
        compiled: The scene.
        reaching: Its arms and reach targets.
        nworld: Number of worlds.
        split: Number of the split.
        size: Capacities. They affect the speed, never the result.
    """

    def __init__(self, compiled: CompiledScene, reaching: Reaching, nworld: int, split: int, size: SearchSize) -> None:
        self._program, self._device = compiled.program, compiled.device
        self._split, self._size = split, size
        self._arms = [
            (one.view, any(t.tier == Tier.CLEAR for t in reaching.targets if t.arm == number))
            for number, one in enumerate(reaching.arms)
        ]
        self.search = create_reach_search(compiled, nworld, size)
        # every wave either tries at least one start of each world, or is filled to its capacity
        most, capacity = sum(STARTS * len(t.grasp_set.grasps) for t in reaching.targets), self.search.failed.shape[0]
        self._most_waves = most + -(-nworld * most // capacity)

    def launch_start(self) -> None:
        """Clear the queue of worlds, which is not empty if earlier launches were interrupted."""
        self.search.worlds_left.zero_()

    def launch(self, layouts: LayoutsView, search: Search) -> None:
        """Find joints in all waiting worlds. A world without joints still waits afterwards, unless it falls back."""
        for reach, clear in self._arms:
            launch_open_worlds(reach, layouts, search, self.search, self._device)
            wave = partial(self._wave, reach, clear, layouts, search)
            repeat_launches(self.search.worlds_left, wave, self._most_waves)

    def _wave(self, reach: Reach, clear: bool, layouts: LayoutsView, search: Search) -> None:
        """Open candidates, run their steps, and keep the first candidate of each world that passes."""
        program, split, size, device = self._program, self._split, self._size, self._device
        launch_open_wave(reach, size, layouts, self.search, device)
        if clear:
            self._test_hand(reach, ReachStep.HAND_AT_GRASP, ReachStep.HAND_AT_GRASP, layouts)
            self._test_hand(reach, ReachStep.HAND_AT_PREGRASP, ReachStep.HAND_AND_TARGET, layouts)
        launch_ik(reach, split, clear, size.lanes, layouts, search, self.search, device)
        last = ReachStep.SCENE_AT_GRASP if clear else ReachStep.SELF_AT_GRASP
        self._test_arm(reach, ReachStep.SELF_AT_GRASP, last, layouts)
        if clear:
            self._test_arm(reach, ReachStep.SELF_AT_PREGRASP, ReachStep.TARGET_AT_PREGRASP, layouts)
        launch_accept_grasps(program, reach, split, size.lanes, layouts, search, self.search, device)

    def _test_hand(self, reach: Reach, first: ReachStep, last: ReachStep, layouts: LayoutsView) -> None:
        """Pose the hand alone, and test it at the steps from `first` to `last`."""
        launch_pose_hand(self._program, reach, first, self._size.lanes, layouts, self.search, self._device)
        launch_test_arm(self._program, reach, first, last, self._size, layouts, self.search, self._device)

    def _test_arm(self, reach: Reach, first: ReachStep, last: ReachStep, layouts: LayoutsView) -> None:
        """Pose the whole robot, and test it at the steps from `first` to `last`."""
        launch_pose_arm(self._program, reach, first, self._size.lanes, layouts, self.search, self._device)
        launch_test_arm(self._program, reach, first, last, self._size, layouts, self.search, self._device)

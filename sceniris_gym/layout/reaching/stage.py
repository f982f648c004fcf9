"""The stages `ik` and `clear` of a reset: after placing, joints of the arm for a grasp of everything asked for.

A world without any for one of its reach targets goes on with its next restart, or, out of them, with its entry of the
bank. No path from the start pose is looked for.
"""

from __future__ import annotations

from functools import partial

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.sequence import repeat_launches
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.hits import launch_test_arm
from sceniris_gym.layout.reaching.ik import launch_ik
from sceniris_gym.layout.reaching.poses import launch_pose_arm, launch_pose_hand
from sceniris_gym.layout.reaching.search import STARTS, Step, create_reach_search
from sceniris_gym.layout.reaching.waves import launch_accept_grasps, launch_open_wave, launch_open_worlds
from sceniris_gym.layout.wave.search import Search, SearchSize
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.reach import Reaching


class ReachStage:
    """Finds joints for the grasps of all worlds that wait for them, in waves of candidates.

    Args:
        compiled: The scene.
        reaching: Its arms and reach targets.
        nworld: Number of worlds.
        split: Number of the split.
        size: Capacities, which affect the speed and never what is found.
    """

    def __init__(self, compiled: CompiledScene, reaching: Reaching, nworld: int, split: int, size: SearchSize) -> None:
        self._program, self._device = compiled.program, compiled.device
        self._split, self._size = split, size
        self._arms = [
            (one.view, any(t.tier == Tier.CLEAR for t in reaching.targets if t.arm == number))
            for number, one in enumerate(reaching.arms)
        ]
        self.search = create_reach_search(compiled, nworld, size)
        # every wave either tries a start of each world, or all the candidates that there is room for
        most, capacity = sum(STARTS * len(t.grasp_set.grasps) for t in reaching.targets), self.search.failed.shape[0]
        self._most_waves = most + -(-nworld * most // capacity)

    def launch_start(self) -> None:
        """Let no world wait, as any might where somebody interrupted the launches."""
        self.search.worlds_left.zero_()

    def launch(self, layouts: LayoutsView, search: Search) -> None:
        """Find joints for all worlds that wait. Those for which there are none still wait, unless they fall back."""
        for reach, clear in self._arms:
            launch_open_worlds(reach, layouts, search, self.search, self._device)
            wave = partial(self._wave, reach, clear, layouts, search)
            repeat_launches(self.search.worlds_left, wave, self._most_waves)

    def _wave(self, reach: Reach, clear: bool, layouts: LayoutsView, search: Search) -> None:
        """Open candidates, take them through the steps, and keep the first of each world that passes."""
        program, split, size, device = self._program, self._split, self._size, self._device
        launch_open_wave(reach, size, layouts, self.search, device)
        if clear:
            self._test_hand(reach, Step.HAND_AT_GRASP, Step.HAND_AT_GRASP, layouts)
            self._test_hand(reach, Step.HAND_AT_PREGRASP, Step.HAND_AND_TARGET, layouts)
        launch_ik(reach, split, clear, size.lanes, layouts, search, self.search, device)
        self._test_arm(reach, Step.SELF_AT_GRASP, Step.SCENE_AT_GRASP if clear else Step.SELF_AT_GRASP, layouts)
        if clear:
            self._test_arm(reach, Step.SELF_AT_PREGRASP, Step.TARGET_AT_PREGRASP, layouts)
        launch_accept_grasps(program, reach, split, size.lanes, layouts, search, self.search, device)

    def _test_hand(self, reach: Reach, first: Step, last: Step, layouts: LayoutsView) -> None:
        """Pose the hand alone, and take it through steps."""
        launch_pose_hand(self._program, reach, first, self._size.lanes, layouts, self.search, self._device)
        launch_test_arm(self._program, reach, first, last, self._size, layouts, self.search, self._device)

    def _test_arm(self, reach: Reach, first: Step, last: Step, layouts: LayoutsView) -> None:
        """Pose all of the robot, and take it through steps."""
        launch_pose_arm(self._program, reach, first, self._size.lanes, layouts, self.search, self._device)
        launch_test_arm(self._program, reach, first, last, self._size, layouts, self.search, self._device)

"""The reach stage of a reset, for the tiers `ik`, `clear` and `path`: find joints for a grasp of every reach target.

The stage follows placing. If no joints are found for a target, the world continues with its next restart. After the
last restart, the world falls back to the bank. Only the tier `path` finds a path to these joints, too.
"""

from functools import partial

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.sequence import launch_beside, repeat_launches
from sceniris_gym.layout.reaching.free_grasps import launch_pose_hands, launch_test_hands
from sceniris_gym.layout.reaching.hits import launch_test_arm
from sceniris_gym.layout.reaching.ik import launch_ik
from sceniris_gym.layout.reaching.paths import launch_test_paths
from sceniris_gym.layout.reaching.poses import launch_pose
from sceniris_gym.layout.reaching.search import STARTS, ReachStep, create_reach_search
from sceniris_gym.layout.reaching.start import TRIALS, launch_accept_starts, launch_pose_start, launch_queue_starts
from sceniris_gym.layout.reaching.waves import launch_accept_grasps, launch_look_up, launch_open_rows, launch_open_wave
from sceniris_gym.layout.wave.search import Workspace
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.reach import Reaching


class ReachStage:
    """Searches for the joints of grasps in all waiting rows, in waves of candidates.

    A row is waiting once all of its objects are placed.

    Args:
        work: The arrays of the generator. Their capacities affect only the speed, not the result.
        reaching: The arms of the scene and their reach targets.
    """

    def __init__(self, work: Workspace, reaching: Reaching) -> None:
        self._work = work
        asked = [t.arm for t in reaching.targets if t.tier >= Tier.CLEAR or work.compiled.starts is not None]
        self._arms = [(one.view, number in asked) for number, one in enumerate(reaching.arms)]
        self.search = create_reach_search(work.compiled, work.nrow, work.size, work.search.free.shape[1])
        self._early = [reach for reach, clear in self._arms if clear and work.search.free.shape[1] > 0]
        # every wave tries at least one candidate of each row, or fills its capacity
        most = sum(STARTS * len(t.grasp_set.grasps) for t in reaching.targets)
        most = most if work.compiled.starts is None else max(most, TRIALS)
        self._most_waves = most + -(-work.nrow * most // self.search.failed.shape[0])

    def launch_pose_hands(self) -> None:
        """Pose the hand at each grasp that later objects may block. Call this once per generator."""
        for reach in self._early:
            launch_pose_hands(self._work, reach, self.search)

    def launch_test_hands(self) -> None:
        """Reject candidates that block the last free grasp of a target of tier `clear`."""
        for reach in self._early:
            launch_test_hands(self._work, reach, self.search)

    def launch(self) -> None:
        """Find joints for grasps in all waiting rows.

        A world keeps the first of its restarts in which joints were found.

        If the scene file has `start`, the arm of this restart then moves to its start pose. If no start pose is free of
        collisions, the restart fails.
        """
        for reach, clear in self._arms:
            launch_open_rows(self._work, reach, self.search)
            repeat_launches(self.search.rows_left, partial(self._wave, reach, clear), self._most_waves)
        for reach, _ in self._arms if self._work.compiled.starts is not None else ():
            launch_queue_starts(self._work, reach, self.search)
            repeat_launches(self.search.rows_left, partial(self._start_wave, reach), self._most_waves)

    def _wave(self, reach: Reach, clear: bool) -> None:
        """Create candidates, run their steps, and keep the first valid candidate of each row."""
        work, search = self._work, self.search
        launch_open_wave(work, reach, search)
        launch_look_up(work, reach, search)
        solve = partial(launch_ik, work, reach, clear, search)
        if clear:
            steps = ReachStep.HAND_AT_GRASP, ReachStep.HAND_AT_PREGRASP, ReachStep.HAND_AND_TARGET
            launch_beside(partial(self._test, reach, *steps), solve, search.failed.device)
            self._test(reach, ReachStep.SELF_AT_GRASP, ReachStep.SELF_AT_PREGRASP, ReachStep.TARGET_AT_PREGRASP)
        else:
            solve()
            self._test(reach, ReachStep.SELF_AT_GRASP, None, ReachStep.SELF_AT_GRASP)
        if search.path.shape[0] > 0:
            launch_test_paths(work, reach, search)
        launch_accept_grasps(work, reach, search)

    def _test(self, reach: Reach, first: ReachStep, second: ReachStep | None, last: ReachStep) -> None:
        """Pose the robot of each candidate, and run the steps from `first` to `last`. `second` begins the pre-grasp."""
        launch_pose(self._work, reach, first, second, self.search)
        launch_test_arm(self._work, reach, first, second, last, self.search)

    def _start_wave(self, reach: Reach) -> None:
        """Pose the candidates for start poses, test them, and keep the first valid candidate of each row."""
        work, search = self._work, self.search
        launch_open_wave(work, reach, search)
        launch_pose_start(work, reach, search)
        launch_test_arm(work, reach, ReachStep.SELF_AT_GRASP, None, ReachStep.SCENE_AT_GRASP, search)
        launch_accept_starts(work, reach, search)

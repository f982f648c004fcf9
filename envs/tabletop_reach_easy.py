"""TabletopReachEasy-v0: TabletopReach-v0 with the vector to the target in the policy's observations."""

from __future__ import annotations

from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, regrouped

from .tabletop_reach import TabletopReach

POLICY = (
    "arm_qpos",
    "arm_qvel",
    "arm_lead",
    "tcp_pose",
    "tcp_to_target",
    "tcp_to_objects",
    "chosen",
    "last_action",
)


class TabletopReachEasy(TabletopReach):
    """TabletopReach-v0, but the policy observes the vector to its target: a first task for a training loop.

    Scene, action, reward, success and the end of an episode are the same as in `TabletopReach-v0`.

    Observations, group `policy`, 58 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | arm_lead | 7 | joint targets minus joint angles [rad] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tcp_to_target | 3 | from the TCP to the target [m] |
    | tcp_to_objects | 5, 3 | from the TCP to the undersides of bottle, apple, orange, can and block [m] |
    | chosen | 5 | 1 for the chosen object, 0 for the others |
    | last_action | 7 | the last action, zeros after a reset |

    Group `critic`, 73 numbers: the same, then `object_velocities` (5, 3: linear velocities of the objects [m/s]).
    """

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        return regrouped(super().observe(s), policy=POLICY, more=("object_velocities",))

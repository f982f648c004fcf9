"""TabletopLiftEasy-v0: TabletopLift-v0 with the grasp, contacts and a timer in the policy's observations."""

from __future__ import annotations

from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, regrouped

from .tabletop_lift import TabletopLift

POLICY = (
    "arm_qpos",
    "arm_qvel",
    "finger_width",
    "tcp_pose",
    "tool_lead",
    "tcp_to_grasp",
    "turn_to_grasp",
    "chosen",
    "tcp_to_objects",
    "touching",
    "held",
    "last_action",
)


class TabletopLiftEasy(TabletopLift):
    """TabletopLift-v0 with the grasp, finger contacts and the holding time in the policy's observations.

    Scene, action, reward, success and the end of an episode are the same as in `TabletopLift-v0`.

    Observations, group `policy`, 57 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | tcp_to_grasp | 3 | from the TCP to the grasp point of the chosen object [m] |
    | turn_to_grasp | 2 | cosine and sine of twice the angle from the tool's yaw to the chosen object's yaw |
    | chosen | 3 | 1 for the chosen object (block, can or lemon), 0 for the others |
    | tcp_to_objects | 5, 3 | from the TCP to the undersides of block, can, lemon, tin and orange [m] |
    | touching | 2 | for each finger, left and right, 1 if it touches the chosen object |
    | held | 1 | uninterrupted time that the object has been held up, in units of 0.5 s (at least 1: success) |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 87 numbers: the same, then `object_velocities` (5, 6: linear [m/s], angular [rad/s]).
    """

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        return regrouped(super().observe(s), policy=POLICY, more=("object_velocities",))

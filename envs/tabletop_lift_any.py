"""TabletopLiftAny-v0: grasp whichever of many things is on a table, and lift it."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, regrouped

from .tabletop_lift import TabletopLift

POLICY = (
    *("arm_qpos", "arm_qvel", "finger_width", "tcp_pose", "tool_lead", "tcp_to_grasp", "turn_to_grasp"),
    *("tcp_to_objects", "object_axes", "extents", "touching", "held", "last_action"),
)


class TabletopLiftAny(TabletopLift):
    """A Panda on a table grasps the thing that a reset brought, one of sixteen, and lifts it by 10 cm.

    As TabletopLift-v0 in frames, action, reward, success and the end of an episode, with another thing to lift in every
    world and at every reset: a bottle, a mug, a banana, bricks and cans of two sizes. In the split `train` there are
    eight of them, in `eval` the other eight. The policy is not told which one it is, but how large it is, and where and
    how to grasp it: at the grasp from above that its layout was accepted for.

    Observations, group `policy`, 75 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | distance between the fingers [m] |
    | tcp_pose | 7 | TCP, the point between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | tcp_to_grasp | 3 | from the TCP to the point where the thing is grasped [m] |
    | turn_to_grasp | 2 | cosine and sine of twice the angle from the tool's yaw to the grasp's |
    | tcp_to_objects | 3, 3 | from the TCP to the undersides of the thing and the two others [m] |
    | object_axes | 3, 6 | their x and z axes |
    | extents | 3, 3 | the edges of the boxes around them, along their axes [m] |
    | touching | 2 | 1 where the left and the right finger touch the thing |
    | held | 1 | time for which it has been held up without a break, in units of 0.5 s; a success from 1 on |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 109 numbers: the same, then

    - `variant` (16): 1 for the thing that it is, 0 for the others,
    - `object_velocities` (3, 6): linear [m/s], angular [rad/s].
    """

    scene = "tabletop_lift_any"
    # Random actions in 4,096 worlds sometimes need more than 256 rows: a gripper pressed on an object of many parts.
    sim_config = SimConfig(nconmax=64, njmax=512)
    targets = ("target",)
    objects = ("target", "first", "second")

    def observe(self, s: State) -> Observation:
        """Return the observations that the class lists."""
        found = super().observe(s)
        extents = torch.stack([s.extent(name) for name in self.objects], dim=1)
        found["critic"] |= {"extents": extents, "variant": s.variant("target", one_hot=True)}
        return regrouped(found, policy=POLICY, more=("variant", "object_velocities"))

    def _grasp(self, s: State, pose: Tensor) -> Tensor:
        """Return the grasp that the layout was accepted for, which moves with the thing, shape (num_envs, 7)."""
        return s.grasp("target")

"""TabletopLiftAny-v0: grasp one of many objects on a table, and lift it."""

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
    """A Panda on a table grasps the target, one of sixteen objects, and lifts it by 10 cm.

    Frames, action, reward, success and the end of an episode are the same as in TabletopLift-v0. Each reset draws a
    target for each world, such as a bottle, a mug or a banana. Blocks, bricks and cans have two sizes. The split
    `train` has eight of the sixteen objects, and `eval` has the other eight. The policy does not observe the kind of
    target. It observes the target's size, and the grasp from above that makes the target reachable in the layout.

    Observations, group `policy`, 75 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | tcp_to_grasp | 3 | from the TCP to the target's grasp point [m] |
    | turn_to_grasp | 2 | cosine and sine of twice the angle from the tool's yaw to the grasp's yaw |
    | tcp_to_objects | 3, 3 | from the TCP to the undersides of the target and the two other objects [m] |
    | object_axes | 3, 6 | x and z axes of the objects |
    | extents | 3, 3 | edges of the objects' bounding boxes along the objects' axes [m] |
    | touching | 2 | for each finger, left and right, 1 if it touches the target |
    | held | 1 | uninterrupted time that the target has been held up, in units of 0.5 s (at least 1: success) |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 109 numbers: the same, then

    - `variant` (16): 1 for the target's variant, 0 for the others,
    - `object_velocities` (3, 6): linear [m/s], angular [rad/s].
    """

    scene = "tabletop_lift_any"
    # Random actions in 4,096 worlds sometimes need more than 256 rows: a gripper pressed on an object of many parts.
    sim_config = SimConfig(nconmax=64, njmax=512)
    targets = ("target",)
    objects = ("target", "first", "second")

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        found = super().observe(s)
        extents = torch.stack([s.extent(name) for name in self.objects], dim=1)
        found["critic"] |= {"extents": extents, "variant": s.variant("target", one_hot=True)}
        return regrouped(found, policy=POLICY, more=("variant", "object_velocities"))

    def _grasp(self, s: State, pose: Tensor) -> Tensor:
        """Return the grasp with which the arm can reach the target, shape (num_envs, 7). It moves with the target."""
        return s.grasp("target")

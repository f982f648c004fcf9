"""ClutterPush-v0: push a tin to a mark on a table, past other objects."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

CLUTTER = ("can", "orange", "block")

OBJECTS = ("tin", *CLUTTER)

BEHIND = 0.06
"""The closed fingers push from a point this far behind the tin's centre, as seen from the mark [m]."""

PUSH_HEIGHT = 0.02
"""Height of the tool above the table while it pushes, and the lowest height of the tool's target [m]."""

CLOSE = 0.04
"""The tin has arrived if its underside is within this distance of the mark [m]."""

AT_REST = 0.01
"""The tin is at rest below this speed [m/s]."""

LOST_HEIGHT = -0.05
"""The tin has fallen off the table if its origin is below this height [m]."""


class ClutterPush(Task):
    """A Panda on a table pushes a tin with closed fingers to a mark, past a can, an orange and a block.

    Frames: poses and velocities are in the robot's base frame (on the table top, x forward, z up). Rotations are wxyz
    quaternions. Every reset draws the positions and yaws of all objects, the position of the mark, and a little noise
    on the arm. The mark is a green disc in images, and may lie under an object. The tool always points down. The can's
    centre is within 5 cm of the straight line from the tin to the mark. The orange and the block may also be in the
    way. An object's underside is the origin of its body, the centre of the face that it stands on at the start. The
    underside moves with the object.

    Action, 4 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad.

    Observations, group `policy`, 44 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tcp_to_tin | 3 | from the TCP to the tin's underside [m] |
    | tin_to_goal | 3 | from the tin's underside to the mark [m] |
    | tcp_to_clutter | 3, 3 | from the TCP to the undersides of can, orange and block [m] |
    | tool_target | 4 | the tool's target: x, y, z [m], yaw [rad] |
    | last_action | 4 | the last action, zeros after a reset |

    Group `critic`, 71 numbers: the same, then

    - `tcp_to_behind` (3): from the TCP to the push point behind the tin [m],
    - `object_velocities` (4, 6): of tin, can, orange and block, linear [m/s] and angular [rad/s].

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the tool is to the push point,
    - `pushing`, 0 to 4: how close the tin's underside is to the mark,
    - `arrived`, 2 while the tin is at the mark,
    - `resting`, 4 while the tin is at rest at the mark,
    - `disturbing`, down to -1: minus half the sum of the other objects' speeds [m/s],
    - `effort`: -0.05 times the mean square of the action.

    Success: the centre of the tin's underside is within 4 cm of the mark and slower than 1 cm/s. The distance includes
    height, so a tin on its side or upside down does not count. An episode succeeds if its last step is a success, so a
    tin that only passes over the mark does not count. The episode terminates when the tin has fallen off the table, and
    is truncated after 250 steps (5 s).
    """

    scene = "clutter_push"
    action_size = 4
    sim_config = SimConfig(nconmax=40, njmax=160)

    def bind(self, s: State) -> None:
        """Find the arm, and allocate the tensors that persist between steps."""
        self.arm = ArmController(s, "panda")
        self.closed = torch.full((s.num_envs,), -1.0, device=s.device)
        self.last_action = torch.zeros(s.num_envs, 4, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool's target, with closed fingers."""
        self.arm.move_tool(s, action, lowest=PUSH_HEIGHT)
        self.arm.grip(s, self.closed)
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        tool, objects = self.arm.tool(s), s.poses(OBJECTS)[:, :, :3]
        to_goal = self.to_goal(s)
        policy = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "tcp_pose": tool,
            "tcp_to_tin": objects[:, 0] - tool[:, :3],
            "tin_to_goal": to_goal,
            "tcp_to_clutter": objects[:, 1:] - tool[:, None, :3],
            "tool_target": self.arm.tool_target,
            "last_action": self.last_action,
        }
        behind = self._behind(objects[:, 0], to_goal) - tool[:, :3]
        return {
            "policy": policy,
            "critic": policy | {"tcp_to_behind": behind, "object_velocities": s.velocities(OBJECTS)},
        }

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring."""
        to_goal = self.to_goal(s)
        away = to_goal.norm(dim=1)
        behind = self._behind(s.pose("tin")[:, :3], to_goal) - self.arm.tool(s)[:, :3]
        speeds = s.velocities(CLUTTER)[:, :, :3].norm(dim=2).sum(dim=1)
        return {
            "reaching": s.dt * (1.0 - torch.tanh(5.0 * behind.norm(dim=1))),
            "pushing": 4.0 * s.dt * (1.0 - torch.tanh(5.0 * away)),
            "arrived": 2.0 * s.dt * (away < CLOSE),
            "resting": 4.0 * s.dt * self.success(s),
            "disturbing": -0.5 * s.dt * speeds.clamp(max=2.0),
            "effort": -0.05 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return whether the tin is at rest on the mark, shape (num_envs,)."""
        return (self.to_goal(s).norm(dim=1) < CLOSE) & (s.velocity("tin")[:, :3].norm(dim=1) < AT_REST)

    def terminated(self, s: State) -> Tensor:
        """Return whether the tin has fallen off the table, shape (num_envs,)."""
        return s.pose("tin")[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Clear the last action, and reset the tool's target to the tool."""
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.arm.start(s, mask)

    def to_goal(self, s: State) -> Tensor:
        """Return the vector from the tin's underside to the mark [m], shape (num_envs, 3)."""
        return s.pose("goal")[:, :3] - s.pose("tin")[:, :3]

    def _behind(self, tin: Tensor, to_goal: Tensor) -> Tensor:
        """Return the push point [m] for the tin's position and the vector to the mark, shape (num_envs, 3)."""
        back = -BEHIND * torch.nn.functional.normalize(to_goal[:, :2], dim=1)
        return tin + torch.cat([back, torch.full_like(back[:, :1], PUSH_HEIGHT)], dim=1)

"""ClutterPush-v0: push a tin to a mark on a table, past other objects."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

CLUTTER = ("can", "orange", "block")

OBJECTS = ("tin", *CLUTTER)

BEHIND = 0.06
"""Where the closed fingers push from: this far behind the centre of the tin, as seen from the mark [m]."""

PUSH_HEIGHT = 0.02
"""Height of the tool over the table while it pushes, and lower limit of its target [m]."""

CLOSE = 0.04
"""Distance of the centre of the tin's underside from the mark that counts as arrived [m]."""

AT_REST = 0.01
"""Below this speed [m/s] the tin is at rest."""

LOST_HEIGHT = -0.05
"""If its origin is below this height [m], the tin has fallen off the table."""


class ClutterPush(Task):
    """A Panda on a table pushes a tin to a mark with closed fingers; a can is in the way, an orange and a block may be.

    Frames: poses and velocities are in the robot's base frame (on the table's top, x to the front, z up), rotations
    are quaternions wxyz. Every reset draws the positions and yaws of all objects, the position of the mark (a green
    disc in pictures), which may be under one of them, and a little noise on the arm. The tool always points down. The
    can's centre is within 5 cm of the straight line from the tin to the mark. An object's underside is the origin of
    its body: the centre of the face that it stands on at the start, turning with the object.

    Action, 4 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad.

    Observations, group `policy`, 44 numbers:

    | name | shape | what |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | tcp_pose | 7 | point between the finger tips: position [m], rotation |
    | tcp_to_tin | 3 | from that point to the tin's underside [m] |
    | tin_to_goal | 3 | from the tin's underside to the mark [m] |
    | tcp_to_clutter | 3, 3 | from the point between the finger tips to the undersides of can, orange and block [m] |
    | tool_target | 4 | the tool's target: x, y, z [m], yaw [rad] |
    | last_action | 4 | the last action, zeros after a reset |

    Group `critic`, 71 numbers: the same, then `tcp_to_behind` (3: from the point between the finger tips to the point
    behind the tin to push from [m]) and `object_velocities` (4, 6: of tin, can, orange and block; linear [m/s] and
    angular [rad/s]).

    Reward terms, in units per second (multiplied by the 0.02 s of a step) and summed: `reaching` (0 to 1, how near the
    tool is to the point to push from), `pushing` (0 to 4, how near the tin's underside is to the mark), `arrived` (2
    while it is there), `resting` (4 while it is at rest there), `disturbing` (minus half the sum of the other objects'
    speeds in m/s, -1 at the lowest) and `effort` (-0.05 times the mean square of the action). Success means that the
    centre of the tin's underside is within 4 cm of the mark, height included, so that a tin on its side or upside down
    does not count, and slower than 1 cm/s. It is judged at the last step: a tin that passes over the mark has not
    arrived. The episode terminates when the tin has fallen off the table, and is truncated after 250 steps (5 s).
    """

    scene = "clutter_push"
    action_size = 4

    def bind(self, s: State) -> None:
        """Find the arm, and allocate what is kept between steps."""
        self.arm = ArmController(s)
        self.closed = torch.full((s.num_envs,), -1.0, device=s.device)
        self.last_action = torch.zeros(s.num_envs, 4, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool, with closed fingers."""
        self.arm.move_tool(s, action, lowest=PUSH_HEIGHT)
        self.arm.grip(s, self.closed)
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations that the class lists."""
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
        """Return the terms reaching, pushing, arrived, resting, disturbing and effort."""
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
        """Return the worlds in which the tin is at rest on the mark."""
        return (self.to_goal(s).norm(dim=1) < CLOSE) & (s.velocity("tin")[:, :3].norm(dim=1) < AT_REST)

    def terminated(self, s: State) -> Tensor:
        """Return the worlds in which the tin has fallen off the table."""
        return s.pose("tin")[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Clear the last action, and start the tool's target at the tool."""
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.arm.start(s, mask)

    def to_goal(self, s: State) -> Tensor:
        """Return the vector from the tin's underside to the mark [m], shape (num_envs, 3)."""
        return s.pose("goal")[:, :3] - s.pose("tin")[:, :3]

    def _behind(self, tin: Tensor, to_goal: Tensor) -> Tensor:
        """Return the point to push from [m], for the tin's position and the vector to the mark, shape (num_envs, 3)."""
        back = -BEHIND * torch.nn.functional.normalize(to_goal[:, :2], dim=1)
        return tin + torch.cat([back, torch.full_like(back[:, :1], PUSH_HEIGHT)], dim=1)

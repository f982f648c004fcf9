"""OpenAny-v0: open a drawer, a door or a lid of furniture that differs in every episode."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bodies import ContactSensor
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

OPEN = 0.6
"""Share of the joint's range at which the part is open."""

FINGERS = ("panda/left_finger", "panda/right_finger")


class OpenAny(Task):
    """A Panda opens what a piece of furniture has: a drawer, a door or a lid.

    Each reset draws one of 24 base units for each world, its position and yaw, and a little noise on the arm. The unit
    is closed. The split `train` has 19 of the units, and `eval` has the other five. The policy does not observe which
    unit or kind of joint is there, only the pose of a grasp at the handle and the opening.

    Frames: poses are in the robot's base frame (on the floor, x forward, z up). Rotations are wxyz quaternions. The
    grasp makes the handle reachable in the layout, and moves with the handle. Its z axis is the approach, and the
    fingers close along its y axis. Rotations of 6 numbers next to a position are axes times 2 sin(angle / 2).

    Action, 7 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    these axes in units of 0.1 rad, and the gripper's opening from -1 (closed) to 1 (open).

    Observations, group `policy`, 48 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 6 | the tool's target minus the tool: position [m], rotation |
    | tcp_to_grasp | 6 | from the TCP to the grasp: position [m], rotation |
    | grasp_axes | 6 | x and z axes of the grasp |
    | opening | 1 | share of the joint's range |
    | last_action | 7 | the last action, zeros after a reset |

    Group `critic`, 51 numbers: the same, then `position` (1): the joint's position [m or rad], and `touching` (2): for
    each finger, left and right, 1 if it touches the part that opens.

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the TCP is to the grasp,
    - `aligning`, 0 to 1: the same for the rotation, near the grasp,
    - `holding`, 1 while both fingers touch the part at the grasp,
    - `opening`, 0 to 6: the opening as a fraction of 0.6 of the range,
    - `effort`: -0.05 times the mean square of the action.

    Success: the opening is at least 0.6 of the joint's range. The episode is truncated after 250 steps (5 s).
    """

    scene = "open_any"
    action_size = 7
    sim_config = SimConfig(nconmax=64, njmax=384)
    unit, part, touched = "unit", "opening", "unit/opening"

    def bind(self, s: State) -> None:
        """Find the arm and its contacts, and allocate the last action."""
        self.arm = ArmController(s, "panda")
        self.touch = ContactSensor(s, FINGERS, (self.touched,))
        self.last_action = torch.zeros(s.num_envs, self.action_size or 0, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool's target, and set the gripper's opening."""
        self.arm.move_tool(s, action[:, :6])
        self.arm.grip(s, action[:, 6])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        tool, grasp, opening = self.arm.tool(s), self.grasp(s), s.joint(self.unit, self.part)
        policy = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "finger_width": self.arm.width(s)[:, None],
            "tcp_pose": tool,
            "tool_lead": self.arm.way_to(s, self.arm.pose_target),
            "tcp_to_grasp": between(tool, grasp),
            "grasp_axes": rotations.axes(grasp[:, 3:]),
            "opening": opening[:, 1:].nan_to_num(),
            "last_action": self.last_action,
        }
        critic = {"position": opening[:, :1].nan_to_num(), "touching": self.touching(s)}
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring."""
        away = between(self.arm.tool(s), self.grasp(s))
        near, turned = away[:, :3].norm(dim=1), away[:, 3:].norm(dim=1)
        return {
            "reaching": s.dt * (0.5 * (1.0 - torch.tanh(4.0 * near)) + 0.5 * torch.exp(-((near / 0.03) ** 2))),
            "aligning": s.dt * torch.exp(-((near / 0.15) ** 2)) * (1.0 - torch.tanh(2.0 * turned)),
            "holding": s.dt * self.touching(s).prod(dim=1) * (near < 0.03),
            "opening": 6.0 * s.dt * (self.opening(s) / OPEN).clamp(0.0, 1.0),
            "effort": -0.05 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return whether the part is open, shape (num_envs,)."""
        return self.opening(s) >= OPEN

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Clear the last action, and reset the tool's target to the tool."""
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.arm.start(s, mask)

    def opening(self, s: State) -> Tensor:
        """Return the opening as a share of the joint's range, shape (num_envs,)."""
        return s.joint(self.unit, self.part)[:, 1]

    def touching(self, s: State) -> Tensor:
        """Return for each finger, left and right, 1 if it touches the body `touched`, else 0, shape (num_envs, 2)."""
        return self.touch(s)[:, :, 0].float()

    def grasp(self, s: State) -> Tensor:
        """Return the grasp at the handle that the layout chose, shape (num_envs, 7)."""
        return s.grasp(self.unit)


def between(start: Tensor, end: Tensor) -> Tensor:
    """Return the way from one pose of the tool to another: position [m], axis times 2 sin(angle / 2), (num_envs, 6).

    A gripper that is turned by half a turn about its approach grasps as well, so the shorter of the two ways counts.
    """
    w, x, y, z = end[:, 3:].unbind(dim=1)
    ends, back = (end[:, 3:], torch.stack([-z, y, -x, w], dim=1)), rotations.conjugate(start[:, 3:])
    one, other = (rotations.multiply(each, back) for each in ends)
    turn = torch.where(one[:, :1].abs() >= other[:, :1].abs(), one, other)
    return torch.cat([end[:, :3] - start[:, :3], 2.0 * rotations.shorter(turn)], dim=1)

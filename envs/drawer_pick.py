"""DrawerPick-v0: lift a banana out of an open drawer."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

CLEAR_HEIGHT = 0.55
"""Height above the floor at which the banana is out [m]: 5 cm above the cabinet, 7 cm above the drawer's face."""

HOLD = 0.5
"""Required holding time above this height [s]."""

FINGERS = ("panda/left_finger", "panda/right_finger")

LOST_HEIGHT = 0.15
"""The banana has fallen out if its origin is below this height [m]. The drawer's floor is at 0.27 m."""

LOWEST = 0.282
"""Lowest height of the tool's target above the floor [m]: the fingertips, 9 mm lower, just clear the drawer's floor."""

YAW_RANGE = (-0.6, 2.4)
"""Limits of the yaw of the tool's target [rad]. The banana's yaw is between 0.3 and 2.2."""


class DrawerPick(Task):
    """A Panda in front of a cabinet takes a banana out of the open upper drawer. An apple lies on the floor.

    Frames: poses and velocities are in the robot's base frame (on the floor, x forward, z up). Rotations are wxyz
    quaternions. Every reset draws the cabinet's position and yaw, the drawer's opening, the poses of banana and apple,
    and a little noise on the arm. The tool always points down. The banana's underside is the origin of its body, the
    centre of the face that it lies on at the start. The banana's axes are the x axis of its body, along the banana, and
    the z axis. Underside and axes move with the banana. The banana's height is the lowest corner of its bounding box
    along the body's axes. This height is exact for a banana that lies as at the start, and up to 4 cm too low for a
    tilted banana.

    Action, 5 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad, and the gripper's opening from -1 (closed) to 1 (open).

    Observations, group `policy`, 47 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | tcp_to_banana | 3 | from the TCP to the banana's underside [m] |
    | banana_axes | 6 | axes of the banana |
    | drawer_pose | 7 | lower edge of the drawer's face: position [m], rotation |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 68 numbers: the same, then

    - `banana_velocity` (6): linear [m/s], angular [rad/s],
    - `apple_pose` (7): position [m], rotation,
    - `touching` (2): for each finger, left and right, 1 if it touches the banana,
    - `held` (1): uninterrupted time that the banana has been held out, in units of 0.5 s (at least 1: success),
    - `tcp_to_grasp` (3): from the TCP to the banana's grasp point [m],
    - `turn_to_grasp` (2): cosine and sine of twice the angle from the tool's yaw to the banana's yaw.

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the tool is to the grasp, or to the funnel above it that leads to the grasp,
    - `aligning`, 0 to 1: above the banana, how well the fingers are aligned across it,
    - `grasping`, 1 while both fingers touch the banana,
    - `lifting`, 0 to 4: the square root of the fraction of the way out, while both fingers touch the banana,
    - `out`, 5 while the banana is out and both fingers touch it,
    - `effort`: -0.05 times the mean square of the action.

    Success: the banana is higher than 0.55 m and both fingers touch it, at the end of the current step and of each of
    the 25 steps (0.5 s) before. Contacts are checked in the last of a step's 4 physics steps only. The episode
    terminates when the banana has fallen out of the drawer, and is truncated after 200 steps (4 s).
    """

    scene = "drawer_pick"
    action_size = 5

    def bind(self, s: State) -> None:
        """Find the arm, its contacts and the banana's bounds, and allocate the tensors that persist between steps."""
        self.arm = ArmController(s, "panda")
        self.touch = ContactSensor(s, FINGERS, ("banana",))
        self.bounds = Bounds(s, ("banana",))
        self.last_action = torch.zeros(s.num_envs, self.action_size or 0, device=s.device)
        self.start_height = torch.zeros(s.num_envs, device=s.device)
        self.held = torch.zeros(s.num_envs, device=s.device)
        self.hold_steps = round(HOLD / s.dt)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool's target, and set the gripper's opening."""
        self.arm.move_tool(s, action[:, :4], lowest=LOWEST, yaw_range=YAW_RANGE)
        self.arm.grip(s, action[:, 4])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        tool, banana, turn = self.arm.tool(s), s.pose("banana"), self._turn(s)
        policy = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "finger_width": self.arm.width(s)[:, None],
            "tcp_pose": tool,
            "tool_lead": self.arm.tool_lead(s),
            "tcp_to_banana": banana[:, :3] - tool[:, :3],
            "banana_axes": rotations.axes(banana[:, 3:]),
            "drawer_pose": s.pose("cabinet/upper_drawer"),
            "last_action": self.last_action,
        }
        critic = {
            "banana_velocity": s.velocity("banana"),
            "apple_pose": s.pose("apple"),
            "touching": self.touching(s),
            "held": (self.held[:, None] - 1.0).clamp(min=0.0) / self.hold_steps,
            "tcp_to_grasp": self._to_grasp(s),
            "turn_to_grasp": torch.stack([turn.cos(), turn.sin()], dim=1),
        }
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring, and count the steps with the banana held out."""
        away, height = self._to_grasp(s), self.height(s)
        aside = away[:, :2].norm(dim=1)
        # a funnel: the farther the tool is to the side, the higher it should be
        distance = torch.hypot(aside, away[:, 2] + (1.5 * (aside - 0.01)).clamp(0.0, 0.2))
        near = 0.5 * (1.0 - torch.tanh(4.0 * distance)) + 0.5 * torch.exp(-((distance / 0.03) ** 2))
        grasped = self.touching(s).prod(dim=1)
        lifted = (height - self.start_height) / (CLEAR_HEIGHT - self.start_height)
        out = grasped * (height > CLEAR_HEIGHT)
        self.held.copy_((self.held + 1.0) * out)
        return {
            "reaching": s.dt * near,
            "aligning": s.dt * (0.5 + 0.5 * self._turn(s).cos()) * torch.exp(-((aside / 0.08) ** 2)),
            "grasping": s.dt * grasped,
            "lifting": 4.0 * s.dt * grasped * lifted.clamp(0.0, 1.0).sqrt(),
            "out": 5.0 * s.dt * out,
            "effort": -0.05 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return whether the banana was held out for 0.5 s, above drawer and cabinet, shape (num_envs,)."""
        return self.held > self.hold_steps  # the first step, plus the steps of HOLD

    def terminated(self, s: State) -> Tensor:
        """Return whether the banana has fallen out of the drawer, shape (num_envs,)."""
        return s.pose("banana")[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Clear the last action and the timer, store the banana's height, and reset the tool's target to the tool."""
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.held.masked_fill_(mask, 0.0)
        self.start_height.copy_(torch.where(mask, self.height(s), self.start_height))
        self.arm.start(s, mask)

    def height(self, s: State) -> Tensor:
        """Return the height of the banana above the floor [m], shape (num_envs,), as defined by the class."""
        return self.bounds.lowest(s.poses(("banana",)))[:, 0]

    def touching(self, s: State) -> Tensor:
        """Return for each finger, left and right, 1 if it touches the banana, 0 if not, shape (num_envs, 2)."""
        return self.touch(s)[:, :, 0].float()

    def _to_grasp(self, s: State) -> Tensor:
        """Return the vector from the tool to the banana's grasp site [m], shape (num_envs, 3)."""
        return s.site("banana/grasp")[:, :3] - self.arm.tool(s)[:, :3]

    def _turn(self, s: State) -> Tensor:
        """Return twice the angle from the tool's yaw to the banana's yaw [rad], shape (num_envs,)."""
        return 2.0 * (rotations.yaw(s.pose("banana")[:, 3:]) - rotations.yaw(self.arm.tool(s)[:, 3:]))

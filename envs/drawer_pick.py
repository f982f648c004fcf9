"""DrawerPick-v0: lift the banana out of an open drawer."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bounds import Bounds
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.touch import Touch

CLEAR_HEIGHT = 0.55
"""Height over the floor that counts as out of the drawer [m]: 5 cm over the cabinet, 7 cm over the drawer's face."""

HOLD = 0.5
"""How long it should be held there [s]."""

FINGERS = ("panda/left_finger", "panda/right_finger")

LOST_HEIGHT = 0.15
"""If its origin is below this height [m], the banana has fallen out of the drawer, whose floor is at 0.27 m."""

FINGER_OPENING = 0.08
"""Distance between the open fingers [m]."""


class DrawerPick(Task):
    """A Panda in front of a cabinet takes a banana out of the open upper drawer; an apple lies on the floor.

    No policy has been trained on it yet.

    Frames: poses and velocities are in the robot's base frame (on the floor, x to the front, z up), rotations are
    quaternions wxyz. Every reset draws the cabinet's position and yaw, the drawer's opening, both fruits and a little
    noise on the arm. The banana's underside is the origin of its body: the centre of the face that it lies on at the
    start, turning with the banana. Its height is that of its lowest point, taken as the lowest corner of the smallest
    box around it along its own axes: this is exact for a banana that lies as at the start, and up to 4 cm too low for a
    tilted one.

    Action, 8 numbers in [-1, 1] at 50 Hz: changes of the targets of joints 1 to 7 in units of 0.04 rad, and the
    gripper from -1 (closed) to 1 (open).

    Observations, group `policy`, 54 numbers:

    | name | shape | what |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | arm_lead | 7 | joint targets minus joint angles [rad] |
    | finger_width | 1 | distance between the fingers [m] |
    | tcp_pose | 7 | point between the finger tips: position [m], rotation |
    | banana_pose | 7 | underside of the banana: position [m], rotation |
    | tcp_to_banana | 3 | from the point between the finger tips to the grasp site of the banana [m] |
    | drawer_pose | 7 | lower edge of the drawer's face: position [m], rotation |
    | last_action | 8 | the last action, zeros after a reset |

    Group `critic`, 70 numbers: the same, then `banana_velocity` (6: [m/s], [rad/s]), `apple_pose` (7: position [m],
    rotation), `touching` (2: 1 where the left and the right finger touch the banana) and `held` (1: how long it has
    been held out without a break, in units of 0.5 s; from 1 on it is a success).

    Reward terms, in units per second (multiplied by the 0.02 s of a step) and summed: `reaching` (0 to 1, how near the
    fingers are to the banana), `grasping` (0 to 1, how far they are closed there), `lifting` (0 to 5, share of the way
    out), `out` (5 while the banana is out and both fingers touch it) and `effort` (-0.01 times the mean square of the
    action). Success means that the banana is higher than 0.55 m and touched by both fingers at the end of 26 steps in a
    row, 0.5 s from the first to the last. Contacts are those of the last of a step's 4 physics steps; those in between
    are not checked. The episode terminates when the banana has fallen out of the drawer, and is truncated after 200
    steps (4 s).
    """

    scene = "drawer_pick"
    action_size = 8

    def bind(self, s: State) -> None:
        """Find the arm, its contacts and the banana's bounds, and allocate what is kept between steps."""
        self.arm = ArmController(s)
        self.touch = Touch(s, FINGERS, ("banana",))
        self.bounds = Bounds(s, ("banana",))
        self.last_action = torch.zeros(s.num_envs, 8, device=s.device)
        self.start_height = torch.zeros(s.num_envs, device=s.device)
        self.held = torch.zeros(s.num_envs, device=s.device)
        self.hold_steps = round(HOLD / s.dt)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the joint targets, and open or close the gripper."""
        self.arm.move_joints(s, action[:, :7])
        self.arm.grip(s, action[:, 7])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations that the class lists."""
        joints = self.arm.qpos(s)
        policy = {
            "arm_qpos": joints,
            "arm_qvel": self.arm.qvel(s),
            "arm_lead": self.arm.targets(s) - joints,
            "finger_width": self.arm.width(s)[:, None],
            "tcp_pose": self.arm.tool(s),
            "banana_pose": s.pose("banana"),
            "tcp_to_banana": self._to_banana(s),
            "drawer_pose": s.pose("cabinet/upper_drawer"),
            "last_action": self.last_action,
        }
        critic = {
            "banana_velocity": s.velocity("banana"),
            "apple_pose": s.pose("apple"),
            "touching": self.touching(s),
            "held": (self.held[:, None] - 1.0).clamp(min=0.0) / self.hold_steps,
        }
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the terms reaching, grasping, lifting, out and effort, and count the steps held out."""
        distance = self._to_banana(s).norm(dim=1)
        near = torch.exp(-((distance / 0.04) ** 2))
        height = self.height(s)
        lifted = (height - self.start_height) / (CLEAR_HEIGHT - self.start_height)
        out = self.touching(s).prod(dim=1) * (height > CLEAR_HEIGHT)
        self.held.copy_((self.held + 1.0) * out)
        return {
            "reaching": s.dt * (1.0 - torch.tanh(5.0 * distance)),
            "grasping": s.dt * near * (1.0 - self.arm.width(s) / FINGER_OPENING).clamp(0.0, 1.0),
            "lifting": 5.0 * s.dt * lifted.clamp(0.0, 1.0),
            "out": 5.0 * s.dt * out,
            "effort": -0.01 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return the worlds in which the banana has been held out for 0.5 s, clear of drawer and cabinet."""
        return self.held > self.hold_steps  # the first one and that many more

    def terminated(self, s: State) -> Tensor:
        """Return the worlds in which the banana has fallen out of the drawer."""
        return s.pose("banana")[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Clear what is kept between steps, and store how high the banana lies."""
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.held.masked_fill_(mask, 0.0)
        self.start_height.copy_(torch.where(mask, self.height(s), self.start_height))

    def height(self, s: State) -> Tensor:
        """Return the height of the banana's lowest point over the floor [m], shape (num_envs,); see the class."""
        return self.bounds.lowest(s.poses(("banana",)))[:, 0]

    def touching(self, s: State) -> Tensor:
        """Return 1 where the left and the right finger touch the banana, else 0; shape (num_envs, 2)."""
        return self.touch(s)[:, :, 0].float()

    def _to_banana(self, s: State) -> Tensor:
        return s.site("banana/grasp")[:, :3] - self.arm.tool(s)[:, :3]

"""DrawerOpenPick-v0: pull a drawer open, and lift a banana out of it."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation

from .drawer_pick import DrawerPick

OPEN = 0.22
"""Opening at which the drawer counts as open [m]. The maximum is 0.25 m."""


class DrawerOpenPick(DrawerPick):
    """A Panda in front of a closed cabinet pulls the upper drawer open, and takes a banana out of it.

    We have not trained a policy on this task yet. Frames, the banana's axes and its height are the same as in
    `DrawerPick-v0`. Every reset draws the cabinet's position and yaw, the poses of banana and apple, and a little noise
    on the arm. Both drawers are closed.

    Action, 8 numbers in [-1, 1] at 50 Hz: changes of the targets of joints 1 to 7 in units of 0.04 rad, and the
    gripper's opening from -1 (closed) to 1 (open).

    Observations, group `policy`, 57 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | arm_lead | 7 | joint targets minus joint angles [rad] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tcp_to_banana | 3 | from the TCP to the banana's underside [m] |
    | banana_axes | 6 | axes of the banana |
    | tcp_to_handle | 3 | from the TCP to the middle of the drawer's handle [m] |
    | drawer_pose | 7 | lower edge of the drawer's face: position [m], rotation |
    | drawer_opening | 1 | opening of the drawer [m] |
    | last_action | 8 | the last action, zeros after a reset |

    Group `critic`, 79 numbers: the same, then `banana_velocity` (6), `apple_pose` (7), `touching` (2), `held` (1),
    `tcp_to_grasp` (3) and `turn_to_grasp` (2) as in `DrawerPick-v0`, and `facing` (1): cosine of the angle between the
    tool's approach and the drawer's depth.

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `handle`, 0 to 1: how close the tool is to the handle, times a factor from 0.5 to 1 for how well the tool faces
      it, or 1 while the drawer is at least 0.22 m open,
    - `opening`, 0 to 3: the drawer's opening as a fraction of 0.22 m,
    - `reaching`, `aligning`, `grasping`, `lifting` and `out` as in `DrawerPick-v0`, while the drawer is at least 0.22 m
      open,
    - `effort`: -0.05 times the mean square of the action.

    Success and termination are the same as in `DrawerPick-v0`. The episode is truncated after 400 steps (8 s).
    """

    scene = "drawer_open_pick"
    action_size = 8

    def apply(self, s: State, action: Tensor) -> None:
        """Move the joint targets, and set the gripper's opening."""
        self.arm.move_joints(s, action[:, :7])
        self.arm.grip(s, action[:, 7])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        seen, joints = super().observe(s)["critic"], self.arm.qpos(s)
        policy = {
            "arm_qpos": joints,
            "arm_qvel": seen["arm_qvel"],
            "arm_lead": self.arm.targets(s) - joints,
            "finger_width": seen["finger_width"],
            "tcp_pose": seen["tcp_pose"],
            "tcp_to_banana": seen["tcp_to_banana"],
            "banana_axes": seen["banana_axes"],
            "tcp_to_handle": self._to_handle(s),
            "drawer_pose": seen["drawer_pose"],
            "drawer_opening": s.qpos("cabinet/upper"),
            "last_action": self.last_action,
        }
        hints = ("banana_velocity", "apple_pose", "touching", "held", "tcp_to_grasp", "turn_to_grasp")
        critic = {name: seen[name] for name in hints} | {"facing": self._facing(s)[:, None]}
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring, and count the steps with the banana held out."""
        picking = super().reward(s, action)
        effort = picking.pop("effort")
        share = (s.qpos("cabinet/upper")[:, 0] / OPEN).clamp(0.0, 1.0)
        opened = (share == 1.0).float()
        near = 1.0 - torch.tanh(4.0 * self._to_handle(s).norm(dim=1))
        handle = near * (0.5 + 0.5 * self._facing(s).clamp(min=0.0))
        return {
            "handle": s.dt * torch.maximum(handle, opened),
            "opening": 3.0 * s.dt * share,
            **{name: term * opened for name, term in picking.items()},
            "effort": effort,
        }

    def _to_handle(self, s: State) -> Tensor:
        """Return the vector from the tool to the handle [m], shape (num_envs, 3)."""
        return s.site("cabinet/upper_handle")[:, :3] - self.arm.tool(s)[:, :3]

    def _facing(self, s: State) -> Tensor:
        """Return the cosine of the angle between the tool's z axis and the drawer's y axis, shape (num_envs,)."""
        drawer = rotations.axes(s.pose("cabinet/upper_drawer")[:, 3:])
        depth = torch.linalg.cross(drawer[:, 3:], drawer[:, :3])
        return (rotations.axes(self.arm.tool(s)[:, 3:])[:, 3:] * depth).sum(dim=1)

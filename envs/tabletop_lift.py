"""TabletopLift-v0: grasp the chosen one of several objects on a table, and lift it."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

GRASP_HEIGHTS = {"block": 0.0225, "can": 0.095, "lemon": 0.025}
"""Objects that can be chosen, and the heights over their undersides at which they are grasped [m].

The palm is 37 mm over the TCP.
"""

OBJECTS = (*GRASP_HEIGHTS, "tin", "orange")

FINGERS = ("panda/left_finger", "panda/right_finger")

LIFTED = 0.1
"""Height over the table at which an object counts as lifted [m]."""

HOLD = 0.5
"""Time for which it has to be held there [s]."""

LOWEST = 0.01
"""Lowest target of the tool over the table [m]; the fingertips reach 9 mm below the tool."""

LOST_HEIGHT = -0.05
"""Height of its origin below which the chosen object has fallen off the table [m]."""


class TabletopLift(Task):
    """A Panda on a table grasps the chosen one of block, can and lemon among other objects, and lifts it by 10 cm.

    Frames: poses and velocities are in the robot's base frame (on the table's top, x forward, z up); rotations are
    quaternions wxyz. Every reset draws the positions and yaws of all objects, which of them is chosen, and a little
    noise on the arm. The tool always points down. An object's underside is the origin of its body: the centre of the
    face on which it stands at the start. It turns with the object. The chosen object's height is that of the lowest
    corner of the smallest box around it along its own axes. This is exact for an object that stands as at the start,
    and up to 2.4 cm too low for a tilted one. Pictures do not show which object is chosen; the attribute `chosen`,
    shape (num_envs, 3), does.

    Action, 5 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad, and the opening of the gripper from -1 (closed) to 1 (open).

    Observations, group `policy`, 79 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | distance between the fingers [m] |
    | tcp_pose | 7 | TCP, the point between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | chosen | 3 | 1 for the chosen one of block, can and lemon, 0 for the others |
    | tcp_to_objects | 5, 3 | from the TCP to the undersides of block, can, lemon, tin and orange [m] |
    | object_axes | 5, 6 | their x and z axes |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 117 numbers: the same, then

    - `tcp_to_grasp` (3): from the TCP to the point where the chosen object is grasped [m],
    - `turn_to_grasp` (2): cosine and sine of twice the angle from the tool's yaw to the chosen object's,
    - `touching` (2): 1 where the left and the right finger touch the chosen object,
    - `held` (1): time for which it has been held up without a break, in units of 0.5 s; a success from 1 on,
    - `object_velocities` (5, 6): linear [m/s], angular [rad/s].

    In `TabletopLiftEasy-v0` the policy observes most of that, too.

    Reward terms, per second (each is multiplied by the 0.02 s of a step), are summed:

    - `reaching`, 0 to 1: how near the tool is to the grasp,
    - `grasping`, 1 while both fingers touch the chosen object,
    - `lifting`, 0 to 4: while both fingers touch it, the share of the way up,
    - `holding`, 5 while it is up and both fingers touch it,
    - `disturbing`, down to -1: minus half the sum of the other objects' speeds [m/s],
    - `effort`: -0.05 times the mean square of the action.

    Success: at the end of 26 steps in a row, 0.5 s from the first to the last, the chosen object is 10 cm or more over
    the table and touched by both fingers. Contacts are those of the last of a step's 4 physics steps; the other three
    are not checked. The episode terminates when the chosen object has fallen off the table, and is truncated after 150
    steps (3 s).
    """

    scene = "tabletop_lift"
    action_size = 5
    targets = tuple(GRASP_HEIGHTS)
    """Objects that can be chosen."""
    objects = OBJECTS
    """All objects on the table, first those that can be chosen."""

    def bind(self, s: State) -> None:
        """Find the arm, its contacts and the objects' bounds, and allocate the tensors that are kept between steps."""
        self.arm = ArmController(s, "panda")
        self.touch = ContactSensor(s, FINGERS, self.targets)
        self.bounds = Bounds(s, self.targets)
        self.grasp_heights = torch.tensor([[0.0, 0.0, height] for height in GRASP_HEIGHTS.values()], device=s.device)
        self.chosen = torch.zeros(s.num_envs, len(self.targets), device=s.device)
        self.held = torch.zeros(s.num_envs, device=s.device)
        self.last_action = torch.zeros(s.num_envs, 5, device=s.device)
        self.hold_steps = round(HOLD / s.dt)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool, and open or close the gripper."""
        self.arm.move_tool(s, action[:, :4], lowest=LOWEST)
        self.arm.grip(s, action[:, 4])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations that the class lists."""
        tool, poses = self.arm.tool(s), s.poses(self.objects)
        grasp = self._grasp(s, self._chosen(poses))
        turn = 2.0 * (rotations.yaw(grasp[:, 3:]) - rotations.yaw(tool[:, 3:]))
        policy = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "finger_width": self.arm.width(s)[:, None],
            "tcp_pose": tool,
            "tool_lead": self.arm.tool_lead(s),
            "chosen": self.chosen,
            "tcp_to_objects": poses[:, :, :3] - tool[:, None, :3],
            "object_axes": rotations.axes(poses[:, :, 3:]),
            "last_action": self.last_action,
        }
        critic = {
            "tcp_to_grasp": grasp[:, :3] - tool[:, :3],
            "turn_to_grasp": torch.stack([turn.cos(), turn.sin()], dim=1),
            "touching": self.touching(s),
            "held": (self.held[:, None] - 1.0).clamp(min=0.0) / self.hold_steps,
            "object_velocities": s.velocities(self.objects),
        }
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the terms that the class lists, and count the steps held up."""
        poses = s.poses(self.objects)
        pose, height = self._chosen(poses), self._height(poses)
        distance = (self._grasp(s, pose)[:, :3] - self.arm.tool(s)[:, :3]).norm(dim=1)
        grasped = self.touching(s).prod(dim=1)
        up = grasped * (height >= LIFTED)
        self.held.copy_((self.held + 1.0) * up)
        near = 0.5 * (1.0 - torch.tanh(4.0 * distance)) + 0.5 * torch.exp(-((distance / 0.03) ** 2))
        speeds = s.velocities(self.objects)[:, :, :3].norm(dim=2)
        others = speeds.sum(dim=1) - (speeds[:, : len(self.targets)] * self.chosen).sum(dim=1)
        return {
            "reaching": s.dt * near,
            "grasping": s.dt * grasped,
            "lifting": 4.0 * s.dt * grasped * (height / LIFTED).clamp(0.0, 1.0),
            "holding": 5.0 * s.dt * up,
            "disturbing": -0.5 * s.dt * others.clamp(max=2.0),
            "effort": -0.05 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return the worlds in which the chosen object has been held up for 0.5 s."""
        return self.held > self.hold_steps  # one step, and as many more as HOLD takes

    def terminated(self, s: State) -> Tensor:
        """Return the worlds in which the chosen object has fallen off the table."""
        return self.chosen_pose(s)[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Choose an object, clear the last action and the timer, and set the tool's target to the tool."""
        drawn = (s.uniform(1) * len(self.targets)).long().clamp(max=len(self.targets) - 1)
        chosen = torch.zeros_like(self.chosen).scatter_(1, drawn, 1.0)
        self.chosen.copy_(torch.where(mask[:, None], chosen, self.chosen))
        self.held.masked_fill_(mask, 0.0)
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.arm.start(s, mask)

    def height(self, s: State) -> Tensor:
        """Return the height of the chosen object over the table [m], shape (num_envs,); see the class."""
        return self._height(s.poses(self.objects))

    def chosen_pose(self, s: State) -> Tensor:
        """Return the pose of the chosen object: position [m], rotation; shape (num_envs, 7)."""
        return self._chosen(s.poses(self.objects))

    def touching(self, s: State) -> Tensor:
        """Return 1 where the left and the right finger touch the chosen object, else 0; shape (num_envs, 2)."""
        return (self.touch(s) * self.chosen[:, None]).sum(dim=2)

    def _chosen(self, poses: Tensor) -> Tensor:
        """Return the pose of the chosen object, out of the poses of all objects, shape (num_envs, 7)."""
        return (self.chosen[:, :, None] * poses[:, : len(self.targets)]).sum(dim=1)

    def _height(self, poses: Tensor) -> Tensor:
        """Return the height of the chosen object [m] from the poses of all objects, shape (num_envs,)."""
        return (self.chosen * self.bounds.lowest(poses[:, : len(self.targets)])).sum(dim=1)

    def _grasp(self, s: State, pose: Tensor) -> Tensor:
        """Return the grasp of the chosen object in that pose, shape (num_envs, 7): the point [m], and the turn."""
        return torch.cat([pose[:, :3] + (self.chosen[:, :, None] * self.grasp_heights).sum(dim=1), pose[:, 3:]], dim=1)

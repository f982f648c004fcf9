"""TabletopLift-v0: grasp the chosen object among several on a table, and lift it."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task

GRASP_HEIGHTS = {"block": 0.0225, "can": 0.095, "lemon": 0.025}
"""Grasp heights over the undersides of the objects that can be chosen [m].

The palm is 37 mm above the TCP.
"""

OBJECTS = (*GRASP_HEIGHTS, "tin", "orange")

FINGERS = ("panda/left_finger", "panda/right_finger")

LIFTED = 0.1
"""Height above the table at which an object counts as lifted [m]."""

HOLD = 0.5
"""Required holding time at this height [s]."""

LOWEST = 0.01
"""Lowest height of the tool's target above the table [m]. The fingertips are 9 mm below the tool."""

LOST_HEIGHT = -0.05
"""The chosen object has fallen off the table if its origin is below this height [m]."""


class TabletopLift(Task):
    """A Panda on a table grasps the chosen object, a block, can or lemon, among other objects, and lifts it by 10 cm.

    Frames: poses and velocities are in the robot's base frame (on the table top, x forward, z up). Rotations are wxyz
    quaternions. Every reset draws the positions and yaws of all objects, the chosen object, and a little noise on the
    arm. The tool always points down. An object's underside is the origin of its body, the centre of the face that it
    stands on at the start. The underside moves with the object. The chosen object's height is the lowest corner of its
    bounding box along the object's axes. This height is exact for an object that stands as at the start, and up to
    2.4 cm too low for a tilted object. Images do not show which object is chosen. The attribute `chosen`, shape
    (num_envs, 3), marks it.

    Action, 5 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad, and the gripper's opening from -1 (closed) to 1 (open).

    Observations, group `policy`, 79 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | chosen | 3 | 1 for the chosen object (block, can or lemon), 0 for the others |
    | tcp_to_objects | 5, 3 | from the TCP to the undersides of block, can, lemon, tin and orange [m] |
    | object_axes | 5, 6 | x and z axes of the objects |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 117 numbers: the same, then

    - `tcp_to_grasp` (3): from the TCP to the grasp point of the chosen object [m],
    - `turn_to_grasp` (2): cosine and sine of twice the angle from the tool's yaw to the chosen object's yaw,
    - `touching` (2): for each finger, left and right, 1 if it touches the chosen object,
    - `held` (1): uninterrupted time that the chosen object has been held up, in units of 0.5 s (at least 1: success),
    - `object_velocities` (5, 6): linear [m/s], angular [rad/s].

    In `TabletopLiftEasy-v0`, the policy also observes most of these values.

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the tool is to the grasp,
    - `grasping`, 1 while both fingers touch the chosen object,
    - `lifting`, 0 to 4: the chosen object's height as a fraction of 10 cm, while both fingers touch the chosen object,
    - `holding`, 5 while the chosen object is up and both fingers touch it,
    - `disturbing`, down to -1: minus half the sum of the other objects' speeds [m/s],
    - `effort`: -0.05 times the mean square of the action.

    Success: the chosen object is at least 10 cm above the table and both fingers touch it, at the end of the current
    step and of each of the 25 steps (0.5 s) before. Contacts are checked in the last of a step's 4 physics steps only.
    The episode terminates when the chosen object has fallen off the table, and is truncated after 150 steps (3 s).
    """

    scene = "tabletop_lift"
    action_size = 5
    sim_config = SimConfig(nconmax=48, njmax=192)
    targets = tuple(GRASP_HEIGHTS)
    """Objects that can be chosen."""
    objects: tuple[str, ...] = OBJECTS
    """All objects on the table. Objects that can be chosen come first."""

    def bind(self, s: State) -> None:
        """Find the arm, its contacts and the objects' bounds, and allocate the tensors that persist between steps."""
        self.arm = ArmController(s, "panda")
        self.touch = ContactSensor(s, FINGERS, self.targets)
        self.bounds = Bounds(s, self.targets)
        self.grasp_heights = torch.tensor([[0.0, 0.0, height] for height in GRASP_HEIGHTS.values()], device=s.device)
        self.chosen = torch.zeros(s.num_envs, len(self.targets), device=s.device)
        self.held = torch.zeros(s.num_envs, device=s.device)
        self.last_action = torch.zeros(s.num_envs, 5, device=s.device)
        self.hold_steps = round(HOLD / s.dt)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool's target, and set the gripper's opening."""
        self.arm.move_tool(s, action[:, :4], lowest=LOWEST)
        self.arm.grip(s, action[:, 4])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
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
        """Return the reward terms listed in the class docstring, and count the steps with the object held up."""
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
        """Return whether the chosen object has been held up for 0.5 s, shape (num_envs,)."""
        return self.held > self.hold_steps  # the first step, plus the steps of HOLD

    def terminated(self, s: State) -> Tensor:
        """Return whether the chosen object has fallen off the table, shape (num_envs,)."""
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
        """Return the height of the chosen object above the table [m], shape (num_envs,), as defined by the class."""
        return self._height(s.poses(self.objects))

    def chosen_pose(self, s: State) -> Tensor:
        """Return the pose of the chosen object: position [m] and rotation, shape (num_envs, 7)."""
        return self._chosen(s.poses(self.objects))

    def touching(self, s: State) -> Tensor:
        """Return for each finger, left and right, 1 if it touches the chosen object, 0 if not, (num_envs, 2)."""
        return (self.touch(s) * self.chosen[:, None]).sum(dim=2)

    def _chosen(self, poses: Tensor) -> Tensor:
        """Select the pose of the chosen object from the poses of all objects, shape (num_envs, 7)."""
        return (self.chosen[:, :, None] * poses[:, : len(self.targets)]).sum(dim=1)

    def _height(self, poses: Tensor) -> Tensor:
        """Return the height of the chosen object [m] from the poses of all objects, shape (num_envs,)."""
        return (self.chosen * self.bounds.lowest(poses[:, : len(self.targets)])).sum(dim=1)

    def _grasp(self, s: State, pose: Tensor) -> Tensor:
        """Return the grasp of the chosen object at `pose`: position [m] and rotation, shape (num_envs, 7)."""
        return torch.cat([pose[:, :3] + (self.chosen[:, :, None] * self.grasp_heights).sum(dim=1), pose[:, 3:]], dim=1)

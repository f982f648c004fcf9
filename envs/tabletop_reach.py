"""TabletopReach-v0: move the tool over the chosen object among several on a table."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import FRICTION_PYRAMIDS, Observation, Task

HEIGHTS = {"bottle": 0.252, "apple": 0.076, "orange": 0.070, "can": 0.122, "block": 0.045}
"""Heights of the objects [m]."""

OBJECTS = tuple(HEIGHTS)

OVER = 0.05
"""Height of the target above the top of the chosen object [m]."""

CLOSE = 0.025
"""The target is reached within this distance [m]."""


class TabletopReach(Task):
    """A Panda on a table moves the point between its fingertips over the chosen object, one of five.

    Frames: poses and velocities are in the robot's base frame (on the table top, x forward, z up). Rotations are wxyz
    quaternions. Every reset draws the positions and yaws of all objects, the chosen object, and a little noise on the
    arm. The target is vertically above the centre of the chosen object's underside, 5 cm above the top of an upright
    object. If the object is pushed, the target moves with it. If the object tips over, the target's height above the
    underside does not change. Images do not show which object is chosen. The attribute `chosen`, shape (num_envs, 5),
    marks it.

    Action, 7 numbers in [-1, 1] at 50 Hz: changes of the targets of joints 1 to 7 in units of 0.04 rad.

    Observations, group `policy`, 55 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | arm_lead | 7 | joint targets minus joint angles [rad] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tcp_to_objects | 5, 3 | from the TCP to the undersides of bottle, apple, orange, can and block [m] |
    | chosen | 5 | 1 for the chosen object, 0 for the others |
    | last_action | 7 | the last action, zeros after a reset |

    Group `critic`, 73 numbers: the same, then

    - `tcp_to_target` (3): from the TCP to the target [m],
    - `object_velocities` (5, 3): linear velocities of the objects [m/s].

    In `TabletopReachEasy-v0`, the policy also observes `tcp_to_target`.

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the tool is to the target, on the scale of the arm,
    - `hovering`, 0 to 2: the same, on the scale of centimetres,
    - `disturbing`, down to -1: minus the sum of the objects' speeds [m/s],
    - `effort`: -0.1 times the mean square of the action.

    Success: the tool is less than 2.5 cm from the target at the end of a step. An episode succeeds if its last step is
    a success, so the tool has to stay near the target. The episode is truncated after 100 steps (2 s).
    """

    scene = "tabletop_reach"
    options = FRICTION_PYRAMIDS
    sim_config = SimConfig(nconmax=40, njmax=160)
    action_size = 7

    def bind(self, s: State) -> None:
        """Find the arm, and allocate the tensors that persist between steps."""
        self.arm = ArmController(s, "panda")
        self.over = torch.tensor([[0.0, 0.0, height + OVER] for height in HEIGHTS.values()], device=s.device)
        self.chosen = torch.zeros(s.num_envs, len(OBJECTS), device=s.device)
        self.last_action = torch.zeros(s.num_envs, 7, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the joint targets."""
        self.arm.move_joints(s, action)
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        tool, positions, qpos = self.arm.tool(s), self._positions(s), self.arm.qpos(s)
        policy = {
            "arm_qpos": qpos,
            "arm_qvel": self.arm.qvel(s),
            "arm_lead": self.arm.targets(s) - qpos,
            "tcp_pose": tool,
            "tcp_to_objects": positions - tool[:, None, :3],
            "chosen": self.chosen,
            "last_action": self.last_action,
        }
        critic = {
            "tcp_to_target": self._target(positions) - tool[:, :3],
            "object_velocities": self._velocities(s),
        }
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring."""
        distance = self.distance(s)
        speeds = self._velocities(s).norm(dim=2).sum(dim=1)
        return {
            "reaching": s.dt * (1.0 - torch.tanh(3.0 * distance)),
            "hovering": 2.0 * s.dt * torch.exp(-((distance / 0.05) ** 2)),
            "disturbing": -s.dt * speeds.clamp(max=1.0),
            "effort": -0.1 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return whether the tool is within 2.5 cm of the target, shape (num_envs,)."""
        return self.distance(s) < CLOSE

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Choose an object, and clear the last action."""
        drawn = (s.uniform(1) * len(OBJECTS)).long().clamp(max=len(OBJECTS) - 1)
        chosen = torch.zeros_like(self.chosen).scatter_(1, drawn, 1.0)
        self.chosen.copy_(torch.where(mask[:, None], chosen, self.chosen))
        self.last_action.masked_fill_(mask[:, None], 0.0)

    def distance(self, s: State) -> Tensor:
        """Return the distance from the TCP to the target [m], shape (num_envs,)."""
        return (self._target(self._positions(s)) - self.arm.tool(s)[:, :3]).norm(dim=1)

    def _target(self, positions: Tensor) -> Tensor:
        """Return the target [m] for objects at `positions`, shape (num_envs, 3)."""
        return (self.chosen[:, :, None] * (positions + self.over)).sum(dim=1)

    def _positions(self, s: State) -> Tensor:
        """Return the positions of the objects [m], shape (num_envs, 5, 3)."""
        return s.poses(OBJECTS)[:, :, :3]

    def _velocities(self, s: State) -> Tensor:
        """Return the linear velocities of the objects [m/s], shape (num_envs, 5, 3)."""
        return s.velocities(OBJECTS)[:, :, :3]

"""KitchenAny-v0: fetch a banana from furniture that differs in every episode, and bring it to a marked place."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector import rotations
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import FRICTION_PYRAMIDS, Observation

from .open_any import OpenAny

NEAR = 0.05
"""Distance between the banana and the goal at which the banana has arrived [m]."""


class KitchenAny(OpenAny):
    """A Panda takes a banana from the unit in front of it, and brings it to a marked place in the air.

    Each reset draws another kitchen for each world: six base units in a row, a counter, two wall units, how far they
    are open, the places of twelve things on and in them, and the goal. The banana is on a worktop, on a board or in a
    drawer of the middle unit, where the arm reaches it without collisions. The policy does not observe which units are
    there. We have not trained a policy on this task yet.

    Frames and action are as in `OpenAny-v0`. The grasp is the one at the banana that makes it reachable in the layout.

    Observations, group `policy`, 57 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 6 | the tool's target minus the tool: position [m], rotation |
    | tcp_to_grasp | 6 | from the TCP to the grasp: position [m], rotation |
    | grasp_axes | 6 | x and z axes of the grasp |
    | opening | 1 | share of the range of the middle unit's joint, 0 if nothing opens |
    | last_action | 7 | the last action, zeros after a reset |
    | banana_axes | 6 | x and z axes of the banana |
    | banana_to_goal | 3 | from the banana's underside to the goal [m] |

    Group `critic`, 66 numbers: the same, then `position` (1): the joint's position [m or rad], `touching` (2): for each
    finger, left and right, 1 if it touches the banana, and `banana_velocity` (6): linear [m/s], angular [rad/s].

    The reward is the sum of `reaching`, `aligning` and `holding` as in `OpenAny-v0`, `carrying` (0 to 6 per second: how
    close the banana is to the goal, while both fingers touch it) and `effort`.

    Success: both fingers touch the banana, and its underside is within 0.05 m of the goal. The episode is truncated
    after 300 steps (6 s).
    """

    scene = "kitchen_any"
    options = FRICTION_PYRAMIDS
    sim_config = SimConfig(nconmax=256, njmax=1024)
    unit, touched = "unit_1", "banana"

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        found, banana = super().observe(s), s.pose("banana")
        more = {"banana_axes": rotations.axes(banana[:, 3:]), "banana_to_goal": s.pose("goal")[:, :3] - banana[:, :3]}
        policy = found["policy"] | more
        return {"policy": policy, "critic": policy | found["critic"] | {"banana_velocity": s.velocity("banana")}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring."""
        terms = super().reward(s, action)
        held = self.touching(s).prod(dim=1)
        terms["carrying"] = 6.0 * s.dt * held * (1.0 - torch.tanh(3.0 * self.distance(s)))
        del terms["opening"]
        return terms

    def success(self, s: State) -> Tensor:
        """Return whether the banana is held at the goal, shape (num_envs,)."""
        return (self.touching(s).prod(dim=1) > 0.0) & (self.distance(s) < NEAR)

    def distance(self, s: State) -> Tensor:
        """Return the distance from the banana's underside to the goal [m], shape (num_envs,)."""
        return (s.pose("goal")[:, :3] - s.pose("banana")[:, :3]).norm(dim=1)

    def grasp(self, s: State) -> Tensor:
        """Return the grasp at the banana that the layout chose, shape (num_envs, 7)."""
        return s.grasp("banana")

"""KitchenReset-v0: a furnished kitchen, to measure the cost of resets."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import FRICTION_PYRAMIDS, SLEEPING, Observation, Task

THINGS = (
    "chest",
    "pan",
    "plate",
    "bottle",
    "mug",
    "bowl",
    "lemon",
    "cereal_box",
    "book",
    "can",
    "tin",
    "glass",
)
ALONE = tuple(name for name in THINGS if name not in ("chest", "lemon"))
"""Objects on furniture that do not support others. The lemon is on the lid of the chest."""


class KitchenReset(Task):
    """A Panda on the worktop of a furnished kitchen with twelve objects. The task has no goal.

    Use it to measure resets, not for training: every reward is 0, and a step is never a success.

    Frames: poses are in the robot's base frame (over the worktop, x forward, z up). Rotations are wxyz quaternions.
    Every reset draws the positions of furniture and objects, the angle of the cupboard's door, and a little noise on
    the arm. Objects sleep in their placed poses until they are touched. Sleep makes steps faster on a GPU, but about
    half as fast on a CPU. In your scene, an object that is placed out of balance does not tip over until it is
    touched.

    Action, 7 numbers in [-1, 1] at 50 Hz: changes of the targets of joints 1 to 7 in units of 0.04 rad.

    Observations, groups `policy` and `critic`, 99 numbers each:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | door | 1 | angle of the cupboard's door [rad] |
    | things | 12, 7 | underside of each object: position [m], rotation |

    The single reward term, `nothing`, is 0. The episode is truncated after 200 steps (4 s).
    """

    scene = "kitchen_reset"
    options = FRICTION_PYRAMIDS | SLEEPING
    action_size = 7
    sim_config = SimConfig(nconmax=256, njmax=1024)

    def bind(self, s: State) -> None:
        """Find the arm."""
        self.arm = ArmController(s, "panda")

    def apply(self, s: State, action: Tensor) -> None:
        """Move the joint targets."""
        self.arm.move_joints(s, action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        seen = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "door": s.qpos("cupboard/door"),
            "things": s.poses(THINGS),
        }
        return {"policy": seen, "critic": seen}

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Let objects sleep in their placed poses, so that steps after a reset are as fast as other steps."""
        s.sleep(ALONE, mask)

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the term `nothing`, which is 0."""
        return {"nothing": torch.zeros(s.num_envs, device=s.device)}

    def success(self, s: State) -> Tensor:
        """Return False for all worlds, because the task has no goal."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)

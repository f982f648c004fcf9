"""TabletopReachPixels-v0: TabletopReach-v0 from images, without object poses."""

from __future__ import annotations

from sceniris_gym.vector.settings import ImageConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, regrouped

from .tabletop_reach import TabletopReach

POLICY = ("arm_qpos", "arm_qvel", "arm_lead", "tcp_pose", "chosen", "last_action")
MORE = ("tcp_to_objects", "tcp_to_target", "object_velocities")


class TabletopReachPixels(TabletopReach):
    """TabletopReach-v0, but the policy has to find the chosen object in the images of two cameras.

    Scene, action, reward, success and the end of an episode are the same as in `TabletopReach-v0`. Images have 64 x 64
    pixels: colour and depth of the camera `front`, which sees the objects and the hand, and colour of the camera
    `wrist`, which looks between the fingers.

    Observations of the arm and the choice, group `policy`, 40 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | arm_lead | 7 | joint targets minus joint angles [rad] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | chosen | 5 | 1 for the chosen object, 0 for the others |
    | last_action | 7 | the last action, zeros after a reset |

    Group `critic`, 73 numbers: the same, then `tcp_to_objects` (5, 3), `tcp_to_target` (3) and `object_velocities`
    (5, 3) of `TabletopReach-v0`.
    """

    images = ImageConfig(
        cameras={
            "front": {"size": (64, 64), "data": ("rgb", "depth"), "thin": True},
            "wrist": {"size": (64, 64), "data": ("rgb",), "thin": True},
        }
    )

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        return regrouped(super().observe(s), policy=POLICY, more=MORE)

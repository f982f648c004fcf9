"""ClutterExtract-v0: extract a peg from clutter without moving the other objects."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.settings import SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import SLEEPING, Observation, Task

KINDS = {
    "can": (0.033, 0.033, 0.033),
    "tin": (0.042, -1.0, -1.0),
    "apple": (0.038, 0.032, 0.015),
    "orange": (0.037, 0.027, -1.0),
    "pear": (0.032, 0.024, 0.018),
    "lemon": (0.034, -1.0, -1.0),
}
"""Radii [m] of each kind of object at the heights of the three parts in HAND, -1 if the object is lower."""

HAND = ((0.025, 0.034, 0.011), (0.030, 0.050, 0.009), (0.0, 0.101, 0.031))
"""Finger pads, fingers and palm: start and end along the closing axis from the TCP, and half the width [m]."""

CLOSE = ("can", "can_2", "tin", "tin_2", "apple", "orange", "pear", "lemon")

AROUND = (
    "can_3", "can_4", "tin_3", "tin_4", "tin_5",
    "apple_2", "apple_3", "orange_2", "orange_3", "pear_2", "lemon_2",
)  # fmt: skip

OTHERS = (*CLOSE, *AROUND)

SLOTS = 11
"""Maximum number of other objects."""

FINGERS = ("panda/left_finger", "panda/right_finger")

GRASP_HEIGHT = 0.035
"""Height of the grasp above the peg's underside [m]. The palm is 37 mm above the TCP."""

LIFTED = 0.1
"""Height above the table at which the peg counts as lifted [m]."""

HOLD = 0.5
"""Required holding time at this height [s]."""

MOVED = 0.02
"""Largest allowed displacement of another object [m]."""

TOPPLED = 0.5
"""Largest allowed tilt of another object [rad]."""

LOWEST = 0.015
"""Lowest height of the tool's target above the table [m]. The fingertips are 9 mm below the tool."""

LOST_HEIGHT = -0.05
"""The peg has fallen off the table if its origin is below this height [m]."""


class ClutterExtract(Task):
    """A Panda on a table grasps a peg among 5 to 11 other objects, and lifts it by 10 cm without moving the others.

    The bounds of at least two other objects are within 3 cm of the peg's bounds, so the fingers often fit on only one
    pair of the peg's sides. The policy has to choose the grasp that the surrounding objects leave free. Every layout
    has at least one such grasp (`reachable: clear`).

    Frames: poses and velocities are in the robot's base frame (on the table top, x forward, z up). Rotations are wxyz
    quaternions. Every reset draws which of 19 other objects are present, the positions and yaws of all objects, and a
    little noise on the arm. The tool always points down. An object's underside is the origin of its body. An object's
    axes are the x and z axes of its body. An object sleeps, in MuJoCo's sense, until it is touched: it does not move,
    and takes no simulation time. The present objects occupy slots, ordered by their distance from the peg at the start.
    Values of empty slots are 0.

    Action, 5 numbers in [-1, 1] at 50 Hz: changes of the tool's target along x, y and z in units of 0.02 m and about
    the vertical in units of 0.1 rad, and the gripper's opening from -1 (closed) to 1 (open).

    Observations, group `policy`, 225 numbers:

    | name | shape | meaning |
    |---|---|---|
    | arm_qpos | 7 | joint angles [rad] |
    | arm_qvel | 7 | joint velocities [rad/s] |
    | finger_width | 1 | gap between the fingers [m] |
    | tcp_pose | 7 | TCP, midway between the fingertips: position [m], rotation |
    | tool_lead | 4 | the tool's target minus the tool: x, y, z [m], yaw [rad] |
    | tcp_to_target | 3 | from the TCP to the peg's underside [m] |
    | target_axes | 6 | axes of the peg |
    | target_from_tool | 9 | underside [m] and axes of the peg in the tool's frame |
    | others_present | 11 | 1 for each occupied slot |
    | others_kind | 11, 6 | 1 for the object's kind: can, tin, apple, orange, pear, lemon |
    | target_to_others | 11, 3 | from the peg's underside to the object's underside [m] |
    | others_from_tool | 11, 3 | the object's underside in the tool's frame [m] |
    | others_up | 11, 3 | the object's z axis |
    | last_action | 5 | the last action, zeros after a reset |

    Group `critic`, 318 numbers: the same, then

    - `touching` (2): for each finger, left and right, 1 if it touches the peg,
    - `held` (1): uninterrupted time that the peg has been held up, in units of 0.5 s,
    - `moved` (11): displacement or tilt of each other object, whichever is larger, as a fraction of its limit,
    - `target_velocity` (6) and `others_velocity` (11, 6): linear [m/s], angular [rad/s],
    - `clear_side` (7): the closing direction with more room around the peg, as cosine and sine of twice its angle and
      of twice its angle from the tool, then the gaps along both axes of the peg, and the larger gap [m].

    The reward is the sum of these terms, per second (each is multiplied by the step of 0.02 s):

    - `reaching`, 0 to 1: how close the tool is to the grasp, or to the funnel above it,
    - `aligning`, 0 to 1: above the peg, how well the fingers align with the direction that has more room,
    - `grasping`, 0 to 2: how close the tool is to the grasp, while both fingers touch the peg,
    - `lifting`, 0 to 4: the square root of the peg's height as a fraction of 10 cm, while both fingers touch the peg,
    - `holding`, 5 while the peg is up and both fingers touch it,
    - `disturbing`, down to -0.75: minus a quarter of the sum of the other objects' speeds [m/s], and minus half of the
      largest fraction in `moved`,
    - `effort`: -0.05 times the mean square of the action.

    `lifting` and `holding` shrink with the largest fraction in `moved`, down to a fifth.

    Success: the peg is at least 10 cm above the table and both fingers touch it, at the end of the current step and of
    each of the 25 steps (0.5 s) before. At the end of the current step, all other objects are within 2 cm and 0.5 rad
    of their start poses. An episode succeeds if its last step is a success. The episode terminates when the peg has
    fallen off the table, and is truncated after 200 steps (4 s).
    """

    scene = "clutter_extract"
    # 99.8% of a trained policy's physics steps need at most 10 iterations. More in one world would delay all worlds.
    options = SLEEPING | {"iterations": 10}
    action_size = 5
    # 81 degrees of freedom: the arm's 9, and 6 for the peg and each of the at most 11 other present objects.
    sim_config = SimConfig(nconmax=128, njmax=512, nvmax=81)

    def bind(self, s: State) -> None:
        """Find the arm, its contacts and the peg's bounds, and allocate the tensors that persist between steps.

        Raises:
            ArgumentError: The scene's groups allow more objects than slots.
        """
        most = sum(group.count[1] for group in s.scene.config.groups.values())
        if most > SLOTS:
            raise ArgumentError(
                f"ClutterExtract-v0: the groups of the scene should have at most {SLOTS} objects present, got up to "
                f"{most}. Lower `count` of the groups in `overrides`."
            )
        self.arm = ArmController(s, "panda")
        self.touch = ContactSensor(s, FINGERS, ("target",))
        self.bounds = Bounds(s, ("target",))
        kinds = [name.split("_")[0] for name in OTHERS]
        self.kinds = torch.eye(len(KINDS), device=s.device)[[list(KINDS).index(kind) for kind in kinds]]
        self.radii = torch.tensor([KINDS[kind] for kind in kinds], device=s.device)
        n = s.num_envs
        self.slots = torch.zeros(n, SLOTS, dtype=torch.long, device=s.device)
        self.filled = torch.zeros(n, SLOTS, device=s.device)
        self.start = torch.zeros(n, SLOTS, 7, device=s.device)
        self.clear = torch.zeros(n, 3, device=s.device)
        self.held = torch.zeros(n, device=s.device)
        self.last_action = torch.zeros(n, 5, device=s.device)
        self.hold_steps = round(HOLD / s.dt)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool's target, and set the gripper's opening."""
        self.arm.move_tool(s, action[:, :4], lowest=LOWEST)
        self.arm.grip(s, action[:, 4])
        self.last_action.copy_(action)

    def observe(self, s: State) -> Observation:
        """Return the observations listed in the class docstring."""
        tool, target, others = self.arm.tool(s), s.pose("target"), self.others(s)
        filled, to_tool = self.filled[:, :, None], rotations.conjugate(tool[:, 3:])
        away, axes = target[:, :3] - tool[:, :3], rotations.axes(target[:, 3:])
        to_others = others[:, :, :3] - tool[:, None, :3]
        # rotate all vectors in one call: to the peg, the peg's two axes, and to the other objects
        ways = torch.cat([away[:, None], axes.unflatten(1, (2, 3)), to_others], dim=1)
        seen = rotations.rotate(to_tool[:, None], ways)
        policy = {
            "arm_qpos": self.arm.qpos(s),
            "arm_qvel": self.arm.qvel(s),
            "finger_width": self.arm.width(s)[:, None],
            "tcp_pose": tool,
            "tool_lead": self.arm.tool_lead(s),
            "tcp_to_target": away,
            "target_axes": axes,
            "target_from_tool": seen[:, :3].flatten(1),
            "others_present": self.filled,
            "others_kind": self.kinds[self.slots] * filled,
            "target_to_others": (others[:, :, :3] - target[:, None, :3]) * filled,
            "others_from_tool": seen[:, 3:] * filled,
            "others_up": rotations.axes(others[:, :, 3:])[:, :, 3:] * filled,
            "last_action": self.last_action,
        }
        critic = {
            "touching": self.touching(s),
            "held": (self.held[:, None] - 1.0).clamp(min=0.0) / self.hold_steps,
            "moved": self.moved(s),
            "target_velocity": s.velocity("target"),
            "others_velocity": self._gather(s.velocities(OTHERS)) * filled,
            "clear_side": self._clear_side(s),
        }
        return {"policy": policy, "critic": policy | critic}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms listed in the class docstring, and count the steps with the peg held up."""
        tool, height = self.arm.tool(s)[:, :3], self.height(s)
        away = s.pose("target")[:, :3] - tool
        aside = away[:, :2].norm(dim=1)
        aligned = 0.5 + 0.5 * self._turn(s).cos()
        # a funnel: the farther the tool is to the side, the higher it should be
        over = (1.5 * (aside - 0.01)).clamp(0.0, 0.12)
        below = away[:, 2] + GRASP_HEIGHT
        distance = torch.hypot(aside, below + over)
        # fingers that press on the peg from above also touch it, so touching counts only near the grasp
        around = torch.exp(-(torch.hypot(aside, below) / 0.03).square())
        grasped = self.touching(s).prod(dim=1)
        up = grasped * (height >= LIFTED)
        self.held.copy_((self.held + 1.0) * up)
        worst = self.moved(s).amax(dim=1).clamp(max=1.0)
        left = 1.0 - 0.8 * worst
        speeds = (self._gather(s.velocities(OTHERS))[:, :, :3].norm(dim=2) * self.filled).sum(dim=1)
        wide, narrow = torch.exp(-((distance / 0.08) ** 2)), torch.exp(-((distance / 0.025) ** 2))
        near = 0.3 * (1.0 - torch.tanh(4.0 * distance)) + 0.3 * wide + 0.4 * narrow
        return {
            "reaching": s.dt * near,
            "aligning": s.dt * aligned * torch.exp(-((aside / 0.08) ** 2)),
            "grasping": 2.0 * s.dt * grasped * around,
            "lifting": 4.0 * s.dt * grasped * left * (height / LIFTED).clamp(0.0, 1.0).sqrt(),
            "holding": 5.0 * s.dt * up * left,
            "disturbing": -s.dt * (0.25 * speeds.clamp(max=1.0) + 0.5 * worst),
            "effort": -0.05 * s.dt * action.square().mean(dim=1),
        }

    def success(self, s: State) -> Tensor:
        """Return whether the peg was held up for 0.5 s and the other objects stayed in place, shape (num_envs,)."""
        return (self.held > self.hold_steps) & (self.moved(s) <= 1.0).all(dim=1)

    def terminated(self, s: State) -> Tensor:
        """Return whether the peg has fallen off the table, shape (num_envs,)."""
        return s.pose("target")[:, 2] < LOST_HEIGHT

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Assign slots to the present objects, and reset the tensors that persist between steps."""
        target, poses = s.pose("target"), s.poses(OTHERS)
        away = (poses[:, :, :2] - target[:, None, :2]).norm(dim=2)
        away = torch.where(s.present(OTHERS), away, torch.inf)
        nearest, slots = away.sort(dim=1, stable=True)
        self.slots.copy_(torch.where(mask[:, None], slots[:, :SLOTS], self.slots))
        self.filled.copy_(torch.where(mask[:, None], nearest[:, :SLOTS].isfinite(), self.filled))
        self.start.copy_(torch.where(mask[:, None, None], self.others(s), self.start))
        self.clear.copy_(torch.where(mask[:, None], self._clearer(s), self.clear))
        self.held.masked_fill_(mask, 0.0)
        self.last_action.masked_fill_(mask[:, None], 0.0)
        self.arm.start(s, mask)
        s.sleep(("target", *OTHERS), mask)

    def height(self, s: State) -> Tensor:
        """Return the height of the peg's lowest corner above the table [m], shape (num_envs,)."""
        return self.bounds.lowest(s.poses(("target",)))[:, 0]

    def touching(self, s: State) -> Tensor:
        """Return for each finger, left and right, 1 if it touches the peg, 0 if not, shape (num_envs, 2)."""
        return self.touch(s)[:, :, 0].float()

    def others(self, s: State) -> Tensor:
        """Return the poses of the objects in the slots: position [m] and rotation, shape (num_envs, 11, 7)."""
        return self._gather(s.poses(OTHERS))

    def moved(self, s: State) -> Tensor:
        """Return the displacement or tilt of each object as a fraction of its limit, shape (num_envs, 11)."""
        now = self.others(s)
        shift = (now[:, :, :3] - self.start[:, :, :3]).norm(dim=2) / MOVED
        before, after = (rotations.axes(pose[:, :, 3:])[:, :, 3:] for pose in (self.start, now))
        tilt = torch.linalg.cross(before, after).norm(dim=2).atan2((before * after).sum(dim=2)) / TOPPLED
        return torch.maximum(shift, tilt) * self.filled

    def _gather(self, values: Tensor) -> Tensor:
        """Select the objects in the slots from `values` of all objects except the peg, shape (num_envs, 11, ...)."""
        return values.gather(1, self.slots[:, :, None].expand(-1, -1, values.shape[2]))

    def _clearer(self, s: State) -> Tensor:
        """Return the angle [rad] of the peg's axis with more room, and the room along both axes [m], (num_envs, 3)."""
        target, others = s.pose("target"), self.others(s)
        flat = others[:, :, :2] - target[:, None, :2]
        radii, absent = self.radii[self.slots], torch.where(self.filled > 0, 0.0, torch.inf)
        along = rotations.axes(target[:, 3:])[:, :2]
        rooms = []
        for axis in (along, torch.stack([-along[:, 1], along[:, 0]], dim=1)):
            far = (flat * axis[:, None]).sum(dim=2).abs()
            beside = (flat[:, :, 0] * axis[:, None, 1] - flat[:, :, 1] * axis[:, None, 0]).abs()
            gaps = [
                torch.hypot((first - far).clamp(min=0.0) + (far - last).clamp(min=0.0), (beside - half).clamp(min=0.0))
                for first, last, half in HAND
            ]
            rooms.append((torch.stack(gaps, dim=2) - radii + absent[:, :, None]).amin(dim=(1, 2)))
        angle = torch.atan2(along[:, 1], along[:, 0]) + 0.5 * torch.pi * (rooms[1] > rooms[0])
        return torch.stack([angle, *rooms], dim=1)

    def _turn(self, s: State) -> Tensor:
        """Return twice the angle [rad] from the fingers' closing axis to the axis with more room, shape (num_envs,)."""
        # the closing axis is the tool's y axis: if the tool points down, it is 90 degrees behind the x axis
        return 2.0 * (self.clear[:, 0] - rotations.yaw(self.arm.tool(s)[:, 3:]) + 0.5 * torch.pi)

    def _clear_side(self, s: State) -> Tensor:
        """Return the observation `clear_side`, shape (num_envs, 7)."""
        angle, turn, rooms = 2.0 * self.clear[:, 0], self._turn(s), self.clear[:, 1:]
        parts = [angle.cos(), angle.sin(), turn.cos(), turn.sin()]
        return torch.cat([torch.stack(parts, dim=1), rooms, rooms.amax(dim=1, keepdim=True)], dim=1)

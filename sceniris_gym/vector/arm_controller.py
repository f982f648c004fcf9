"""`ArmController`: moves an arm by its joints or by its tool, and opens and closes its gripper."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.vector import rotations
from sceniris_gym.vector.state import State

JOINT_STEP = 0.04
"""Largest change of a joint's target in a control step [rad]: 2 rad/s at 50 Hz."""

TOOL_STEP = 0.02
"""Largest change of the tool's target along an axis in a control step [m]: 1 m/s at 50 Hz."""

TOOL_LEAD = 0.05
"""How far the tool's target may lead the tool along an axis [m]."""

TURN_STEP = 0.1
"""Largest change of the tool's target yaw in a control step [rad]."""

TURN_LEAD = 0.3
"""How far the target yaw may lead the tool's yaw [rad]."""

TURN_LIMIT = 1.7
"""Largest target yaw to either side by default [rad]: a gripper is the same after half a turn."""

DAMPING = 1e-3
"""Damping of the inverse kinematics [m^2]: its root is 3 cm/rad, a tenth of what a joint moves the tool by."""

POSTURE_GAIN = 0.1
"""Share of the way back to the home pose that the joints go in a step, as far as that does not move the tool."""


class ArmController:
    """Reads and drives an arm with position actuators, in all worlds of a State and without host synchronisation.

    Its actuators are `<name>/joint1` and so on, and `<name>/gripper`, which commands the travel of a finger; its
    tool is the site `<name>/tcp`.

    Args:
        s: The worlds.
        name: The arm's name in the scene, which is that of its asset.

    Attributes:
        joints: Number of joints, without the fingers.
        lead: How far a joint's target may lead the joint [rad], shape (joints,): enough for its actuator to reach full
            force and speed. With a larger lead, a target would only take longer to come back.
        tool_target: Target of the tool for `move_tool`: x, y, z [m] and yaw [rad] in the base frame, shape
            (num_envs, 4).

    Raises:
        UnknownNameError: The scene has no such arm.
    """

    def __init__(self, s: State, name: str = "panda") -> None:
        self.name, mjm = name, s.mjm
        names = [mjm.actuator(i).name for i in range(mjm.nu)]
        columns = [i for i, actuator in enumerate(names) if actuator.startswith(f"{name}/joint")]
        if not columns:
            raise UnknownNameError("arm", name, f"scene '{s.scene.config.name}'", {n.split("/")[0] for n in names})
        self.joints, self._first = len(columns), columns[0]
        self._gripper = s.actuator(f"{name}/gripper")
        limits = s.control_range
        self._lower, self._upper = limits[columns].unbind(dim=1)
        self._open = limits[self._gripper, 1]
        self.lead = _full_leads(s, columns)
        self._home = torch.tensor(s.scene.home_ctrl[columns], dtype=torch.float32, device=s.device)
        self._step = torch.tensor([TOOL_STEP] * 3 + [TURN_STEP], device=s.device)
        self._lead = torch.tensor([TOOL_LEAD] * 3 + [TURN_LEAD], device=s.device)
        self._damping = DAMPING * torch.eye(6, device=s.device)
        self.tool_target = torch.zeros(s.num_envs, 4, device=s.device)

    def targets(self, s: State) -> Tensor:
        """Return the targets of the joints [rad], a view to write to, shape (num_envs, joints)."""
        return s.ctrl[:, self._first : self._first + self.joints]

    def qpos(self, s: State) -> Tensor:
        """Return the joint angles [rad], shape (num_envs, joints)."""
        return s.qpos(self.name)[:, : self.joints]

    def qvel(self, s: State) -> Tensor:
        """Return the joint velocities [rad/s], shape (num_envs, joints)."""
        return s.qvel(self.name)[:, : self.joints]

    def tool(self, s: State) -> Tensor:
        """Return the tool's position [m] and orientation (wxyz), shape (num_envs, 7)."""
        return s.site(f"{self.name}/tcp")

    def width(self, s: State) -> Tensor:
        """Return the distance between the fingers [m], shape (num_envs,)."""
        return s.qpos(self.name)[:, self.joints :].sum(dim=1)

    def move_joints(self, s: State, action: Tensor) -> None:
        """Change the targets of the joints by JOINT_STEP times `action`, shape (num_envs, joints) in [-1, 1]."""
        qpos, targets = self.qpos(s), self.targets(s)
        moved = (targets + JOINT_STEP * action).clamp(qpos - self.lead, qpos + self.lead)
        targets.copy_(moved.clamp(self._lower, self._upper))

    def start(self, s: State, mask: Tensor) -> None:
        """Set the tool's target to where the tool is in the masked worlds; call it after their reset."""
        self.tool_target.copy_(torch.where(mask[:, None], self._tool_now(s), self.tool_target))

    def move_tool(
        self, s: State, action: Tensor, lowest: float = 0.0, turns: tuple[float, float] = (-TURN_LIMIT, TURN_LIMIT)
    ) -> None:
        """Move the tool, which points down, along the axes of the base frame, and turn it about the vertical.

        The target changes by `action` times 0.02 m and 0.1 rad, and leads the tool by TOOL_LEAD and TURN_LEAD at most.
        Joint targets follow by damped least squares, dq = J^T (J J^T + lambda I)^-1 e (Wampler 1986), plus the part of
        a step towards the home pose that does not move the tool.

        Args:
            s: The worlds.
            action: Changes of x, y, z and yaw in [-1, 1], shape (num_envs, 4).
            lowest: Lower limit of the target's height [m], base frame.
            turns: Limits of the target's yaw [rad], within half a turn.
        """
        now = self._tool_now(s)
        target = (self.tool_target + self._step * action).clamp(now - self._lead, now + self._lead)
        target[:, 2].clamp_(min=lowest)
        target[:, 3].clamp_(*turns)
        self.tool_target.copy_(target)
        half, zero = 0.5 * target[:, 3], torch.zeros_like(target[:, 3])
        # half a turn about x, then the yaw: the tool's z axis points down
        wanted = torch.stack([zero, half.cos(), half.sin(), zero], dim=1)
        turn = rotations.multiply(wanted, rotations.conjugate(self.tool(s)[:, 3:]))
        turn = 2.0 * turn[:, 1:] * torch.where(turn[:, :1] < 0.0, -1.0, 1.0)
        error = torch.cat([target[:, :3] - now[:, :3], turn], dim=1)

        jacobian = s.jacobian(f"{self.name}/tcp", self.name)[:, :, : self.joints]
        transposed = jacobian.transpose(1, 2)
        inverse = transposed @ torch.linalg.inv_ex(jacobian @ transposed + self._damping)[0]
        qpos = self.qpos(s)
        posture = POSTURE_GAIN * (self._home - qpos)
        moved = posture + (inverse @ (error[:, :, None] - jacobian @ posture[:, :, None]))[:, :, 0]
        # all joints slow down together, so that the tool keeps its direction
        moved = moved / (moved / self.lead).abs().amax(dim=1, keepdim=True).clamp(min=1.0)
        self.targets(s).copy_((qpos + moved).clamp(self._lower, self._upper))

    def tool_lead(self, s: State) -> Tensor:
        """Return the tool's target minus the tool: x, y, z [m] and yaw [rad], shape (num_envs, 4)."""
        return self.tool_target - self._tool_now(s)

    def _tool_now(self, s: State) -> Tensor:
        """Return position [m] and yaw [rad] of the tool, shape (num_envs, 4)."""
        pose = self.tool(s)
        return torch.cat([pose[:, :3], rotations.yaw(pose[:, 3:])[:, None]], dim=1)

    def grip(self, s: State, action: Tensor) -> None:
        """Set the gripper's target from -1 (closed) to 1 (open), shape (num_envs,)."""
        s.ctrl[:, self._gripper] = self._open * 0.5 * (action + 1.0)


def _full_leads(s: State, columns: list[int]) -> Tensor:
    """Return how far each joint lags behind its target at full force and speed [rad], shape (len(columns),).

    The force F is then balanced by the joint's damping d alone, so that the speed is F / d; and the actuator's own law
    F = kp lead - kv F / d gives the lead.
    """
    mjm = s.mjm
    force, gain, speed_gain = (
        mjm.actuator_forcerange[columns, 1],
        mjm.actuator_gainprm[columns, 0],
        -mjm.actuator_biasprm[columns, 2],
    )
    damping = mjm.dof_damping[mjm.jnt_dofadr[mjm.actuator_trnid[columns, 0]]]
    return torch.tensor(force / gain * (1.0 + speed_gain / damping), dtype=torch.float32, device=s.device)

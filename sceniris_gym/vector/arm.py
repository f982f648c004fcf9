"""An arm as tasks drive it: joint targets that cannot run away, a tool that moves straight, and a gripper."""

from __future__ import annotations

from torch import Tensor

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.vector.state import State

JOINT_STEP = 0.04
"""Largest change of a joint's target in a control step [rad]: 2 rad/s at 50 Hz."""

TARGET_LEAD = 0.2
"""How far a joint's target may be ahead of the joint [rad]; keeps targets from running away from a blocked arm."""


class Arm:
    """Reads and drives an arm with position actuators, in all worlds of a State and without host synchronisation.

    Its actuators are `<name>/joint1` and so on, and `<name>/gripper`, which commands the travel of a finger; its
    tool is the site `<name>/tcp`.

    Args:
        s: the worlds
        name: the arm's name in the scene, that of its asset

    Attributes:
        joints: number of joints, fingers aside

    Raises:
        UnknownNameError: the scene has no such arm
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
        moved = (targets + JOINT_STEP * action).clamp(qpos - TARGET_LEAD, qpos + TARGET_LEAD)
        targets.copy_(moved.clamp(self._lower, self._upper))

    def grip(self, s: State, action: Tensor) -> None:
        """Set the gripper's target from -1 (closed) to 1 (open), shape (num_envs,)."""
        s.ctrl[:, self._gripper] = self._open * 0.5 * (action + 1.0)

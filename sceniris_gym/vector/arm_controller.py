"""`ArmController`: moves the joints or the tool of a robot's arm, and the robot's gripper."""

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArmError, refuses_old_names
from sceniris_gym.vector import rotations
from sceniris_gym.vector.actuators import Fingers, PositionActuators
from sceniris_gym.vector.names import SLIDE
from sceniris_gym.vector.readings import as_columns
from sceniris_gym.vector.robots import arm_joints, find_robot
from sceniris_gym.vector.state import State
from sceniris_gym.vector.tool_pose import Frame, Lead, changed, check_action, limited

JOINT_STEP = 0.04
"""Largest change of a hinge's target in a control step [rad]: 2 rad/s at 50 Hz."""

TOOL_STEP = 0.02
"""Largest change of the tool's target along an axis, and of a slide's target, in a control step [m]: 1 m/s at 50 Hz."""

TOOL_LEAD = 0.05
"""Largest distance along an axis by which the tool's target may be ahead of the tool [m]."""

YAW_STEP = 0.1
"""Largest change of the tool's target yaw in a control step [rad]."""

YAW_LEAD = 0.3
"""Largest angle by which the target yaw may be ahead of the tool's yaw [rad]."""

YAW_LIMIT = 1.7
"""Default limit of the target yaw in both directions [rad]. A gripper is symmetric under a rotation by pi."""

DAMPING = 1e-3
"""Damping of the inverse kinematics [m^2]. The root, 3 cm/rad, is about a tenth of a joint's lever on the tool."""

TOOL_RATE = 15.0
"""Least rate at which joints approach the target of six numbers [1/s]. Slow actuators get targets further ahead."""

OSC_STEP = (0.05, 0.05, 0.05, 0.5, 0.5, 0.5)
"""Change of the tool's pose by an action of ones, in robosuite's OSC_POSE [m, rad]."""

OSC_LEAD = (0.05, 1.0)
"""Leads that no action of OSC_POSE exceeds: 0.05 m along an axis, and 0.5 rad times the root of 3."""

OSC_RATE = 6.1
"""Rate at which OSC_POSE approaches a target [1/s]: stiffness 150 over damping 2 sqrt(150)."""

OSC_GRIP_SPEED = 5.0
"""Speed of the gripper's command in robosuite's OSC_POSE [1/s], from -1 to 1."""

POSTURE_GAIN = 0.1
"""Fraction of the way to the home pose that the joints move in each step, within the null space of the tool."""


class ArmController:
    """Controller of one robot, in all worlds of a State at once and without host synchronisation.

    The arm is the chain of hinges and slides from the robot's root body to its tool centre point (`tcp` in the scene,
    by default the site 'tcp'). Each joint needs a separate position actuator, which may act through a tendon and with
    any gear. The gripper consists of limited joints beyond the arm's last joint. Actuators open and close these joints
    directly, through tendons or through joint equalities. The names of the robot's joints and actuators do not matter.

    Args:
        s: The worlds.
        name: The robot's name in `robots` of the scene. If the scene has only one robot, None selects this robot, and
            its name is the name of its asset or root body, such as 'panda'.

    Attributes:
        name: The robot's name.
        joints: Number of joints of the arm.
        joint_ids: Ids of these joints in the model, from base to tip, for `State.qpos` and `State.put_joints`:
            `s.put_joints(arm.joint_ids, s.pregrasp_qpos("can"), mask)`.
        has_gripper: Whether `grip` and `width` can be used.
        lead: How far a joint's target may be ahead of the joint [rad or m], shape (joints,). At this lead, the actuator
            reaches its full force and speed. With a larger lead, the target would only take longer to reverse. The lead
            is infinite if neither the joint nor its actuator has a force limit.
        tool_target: Target of the tool for `move_tool`: x, y, z [m] and yaw [rad] in the base frame, shape
            (num_envs, 4). In a scene with several robots, x, y and z are in the world frame, and the yaw is relative to
            the yaw of the robot's base.
        pose_target: Target of the tool for actions of six numbers: position [m] and orientation (wxyz), in the frame of
            `tool`, shape (num_envs, 7).

    Raises:
        UnknownNameError: The scene has no such robot.
        ArgumentError: No name is given, although the scene has several robots.
        ArmError: The scene has no robot, or the robot has `in_scene: false`. The robot has no tool centre point, or no
            joint before it. A joint is not a hinge or a slide, or has no separate position actuator.
    """

    def __init__(self, s: State, name: str | None = None) -> None:
        def tensor(values: object) -> Tensor:
            return torch.tensor(np.asarray(values), dtype=torch.float32, device=s.device)

        mjm, robots, where = s.mjm, s.scene.config.all_robots, f"scene '{s.scene.config.name}': ArmController"
        robot = find_robot(s.scene, name, where)
        where = f"{where}: {robots[robot].section}"
        arm = arm_joints(s.scene, robot, where)
        self.name = robot if s.scene.config.robots else robots[robot].name
        self.joints, self.joint_ids, self._tcp = len(arm), arm, s.scene.tcps[robot]
        self._base = robot if len(robots) > 1 else None
        self._actuators = PositionActuators(mjm, arm, s.device, where)
        steps = np.where(mjm.jnt_type[list(arm)] == SLIDE, TOOL_STEP, JOINT_STEP)
        self.lead = tensor(np.maximum(self._actuators.full_leads(steps / s.dt), steps))
        self._joint_step, self._home = tensor(steps), tensor(s.scene.home_qpos[mjm.jnt_qposadr[list(arm)]])
        self._lead = tensor([TOOL_LEAD] * 3 + [YAW_LEAD])
        self._damping = DAMPING * torch.eye(6, device=s.device)
        self.tool_target, self.pose_target = (torch.zeros(s.num_envs, n, device=s.device) for n in (4, 7))
        self._step, self._osc_step = tensor([TOOL_STEP] * 3 + [YAW_STEP] * 3), tensor(OSC_STEP)
        self._gain = tensor(np.maximum(self._actuators.gains(TOOL_RATE, s.dt), 1.0))
        self._osc_gain = tensor(self._actuators.gains(OSC_RATE, s.dt))
        self._where, self._fingers = where, Fingers.find(s.scene, mjm.site(self._tcp).id, arm)
        self.has_gripper = self._fingers is not None
        if self._fingers is not None:
            closed, opened = self._fingers.closed, self._fingers.opened
            self._grip, self._closed = as_columns(self._fingers.controls, s.device), tensor(closed)
            self._half, self._closed_qpos = tensor(0.5 * (opened - closed)), tensor(self._fingers.closed_qpos)
            self._width = None if self._fingers.width is None else tensor(self._fingers.width)

    def targets(self, s: State) -> Tensor:
        """Return the targets of the joints [rad or m], shape (num_envs, joints)."""
        return self._actuators.targets(s.ctrl)

    def set_targets(self, s: State, targets: Tensor) -> None:
        """Set the targets of the joints [rad or m], shape (num_envs, joints), within joint and control limits."""
        self._actuators.set_targets(s.ctrl, targets)

    def qpos(self, s: State) -> Tensor:
        """Return the joint positions [rad or m], shape (num_envs, joints)."""
        return s.qpos(self.joint_ids)

    def qvel(self, s: State) -> Tensor:
        """Return the joint velocities [rad/s or m/s], shape (num_envs, joints)."""
        return s.qvel(self.joint_ids)

    def tool(self, s: State) -> Tensor:
        """Return the tool's position [m] and orientation (wxyz), as `s.site` does, shape (num_envs, 7)."""
        return s.site(self._tcp)

    def width(self, s: State) -> Tensor:
        """Return the opening of the gripper [m], shape (num_envs,). It is 0 if the gripper is closed.

        The opening is the sum of the sideways motions of all fingers. For fingers on slides, it is exact. For fingers
        on hinges, it is an approximation proportional to the angle.

        Raises:
            ArmError: The robot has no gripper, or its fingers are parts of linkages, which a `connect` or a `weld`
                closes.
        """
        fingers = self._gripper()
        if self._width is None:
            raise ArmError(
                f"{self._where}: the robot's fingers hang on linkages, so their joints do not give the opening. Use "
                "the distance between two bodies or sites of the hand, from State.poses or State.site."
            )
        return ((s.qpos(fingers.joints) - self._closed_qpos) * self._width).sum(dim=1)

    def move_joints(self, s: State, action: Tensor) -> None:
        """Change the joint targets by `action` times JOINT_STEP for hinges, and `action` times TOOL_STEP for slides.

        Args:
            s: The worlds.
            action: Changes in [-1, 1], shape (num_envs, joints).

        Raises:
            ArgumentError: `action` has another shape.
        """
        check_action(action, (self.joints,), "base", f"{self._where}: move_joints")
        qpos = self.qpos(s)
        self.set_targets(s, (self.targets(s) + self._joint_step * action).clamp(qpos - self.lead, qpos + self.lead))

    def start(self, s: State, mask: Tensor) -> None:
        """Set the tool's targets to the tool's pose in the masked worlds. Call this method after their reset."""
        self.tool_target.copy_(torch.where(mask[:, None], self._tool_now(s), self.tool_target))
        self.pose_target.copy_(torch.where(mask[:, None], self.tool(s), self.pose_target))

    @refuses_old_names
    def move_tool(
        self,
        s: State,
        action: Tensor,
        lowest: float = 0.0,
        yaw_range: tuple[float, float] = (-YAW_LIMIT, YAW_LIMIT),
        frame: Frame = "base",
    ) -> None:
        """Move the tool by x, y, z and yaw, or by x, y, z and a rotation vector.

        Four numbers change `tool_target`. They move the tool along the axes of the base frame, and rotate it about the
        vertical. The tool points down. Six numbers change `pose_target`, for any orientation of the tool. The rotation
        vector, their last three, has the direction of the rotation's axis and the length of its angle.

        The target changes by `action` times TOOL_STEP and YAW_STEP, and is ahead of the tool by at most TOOL_LEAD and
        YAW_LEAD. Joint targets follow by damped least squares, dq = J^T (J J^T + lambda I)^-1 e (Wampler 1986), plus a
        step towards the home pose. Only the null-space part of this step is used, so it does not move the tool. Six
        numbers also hold the weight of the arm. In a scene with several robots, the tool moves along the world's axes.

        Args:
            s: The worlds.
            action: Changes in [-1, 1], shape (num_envs, 4) or (num_envs, 6).
            lowest: Lower limit of the target's z [m].
            yaw_range: Limits of the target's yaw [rad], within [-pi, pi]. Only for four numbers.
            frame: The axes of six numbers: "base", or "tool" for the axes of the target before the change.

        Raises:
            ArgumentError: `action` has another shape, `frame` is another word, or `frame` is "tool" for four numbers.
        """
        check_action(action, (4, 6), frame, f"{self._where}: move_tool")
        if action.shape[1] == 6:
            target = changed(self.pose_target, self._step * action, frame)
            return self._move_pose(s, target, (TOOL_LEAD, YAW_LEAD), lowest, self._gain)
        now = self._tool_now(s)
        target = (self.tool_target + self._step[:4] * action).clamp(now - self._lead, now + self._lead)
        target[:, 2].clamp_(min=lowest)
        target[:, 3].clamp_(*yaw_range)
        self.tool_target.copy_(target)
        yaw = target[:, 3] if self._base is None else target[:, 3] + self._facing(s)
        half, zero = 0.5 * yaw, torch.zeros_like(yaw)
        # a rotation by pi about x, then the yaw: the tool's z axis points down
        wanted = torch.stack([zero, half.cos(), half.sin(), zero], dim=1)
        quat = rotations.multiply(wanted, rotations.conjugate(self.tool(s)[:, 3:]))
        error = torch.cat([target[:, :3] - now[:, :3], 2.0 * rotations.shorter(quat)], dim=1)
        self.set_targets(s, self._joint_targets(s, error))

    def move_osc_pose(self, s: State, action: Tensor) -> None:
        """Move the tool and the gripper by an action of robosuite's controller OSC_POSE, which LIBERO uses.

        The action has x, y, z in units of 0.05 m, a rotation vector in units of 0.5 rad, and the gripper. Axes are the
        base frame's. The target is the tool's present pose plus this change, and the arm approaches it at OSC_POSE's
        rate. The gripper closes if its number is positive, opens if it is negative, and stops at 0. In 0.4 s, it moves
        from open to closed.

        Args:
            s: The worlds.
            action: Changes in [-1, 1], shape (num_envs, 7), or (num_envs, 6) without the gripper.

        Raises:
            ArgumentError: `action` has another shape.
            ArmError: The robot has no gripper, but `action` has seven numbers.
        """
        check_action(action, (6, 7), "base", f"{self._where}: move_osc_pose")
        target = changed(self.tool(s), self._osc_step * action[:, :6], "base")
        self._move_pose(s, target, OSC_LEAD, -torch.inf, self._osc_gain)
        if action.shape[1] == 7:
            self._gripper()
            grip = (s.ctrl[:, self._grip] - self._closed) / self._half - 1.0
            self.grip(s, (grip[:, 0] - OSC_GRIP_SPEED * s.dt * action[:, 6].sign()).clamp(-1.0, 1.0))

    def _move_pose(self, s: State, target: Tensor, lead: Lead, lowest: float, gain: Tensor) -> None:
        """Set `pose_target` to `target` within the lead, and the joint targets `gain` times the way to it."""
        target, error = limited(target, self.tool(s), lead, lowest)
        self.pose_target.copy_(target)
        targets = self._joint_targets(s, error, gain) + self._actuators.bearing(s)
        self.set_targets(s, self._actuators.within_force(s, targets, self.qpos(s), self.qvel(s)))

    def _joint_targets(self, s: State, error: Tensor, gain: Tensor | float = 1.0) -> Tensor:
        """Return the joint targets `gain` times the way to a tool's pose that differs by `error` (num_envs, 6)."""
        jacobian = s.jacobian(self._tcp, self.joint_ids)
        transposed = jacobian.transpose(1, 2)
        inverse = transposed @ torch.linalg.inv_ex(jacobian @ transposed + self._damping)[0]
        qpos = self.qpos(s)
        posture = POSTURE_GAIN * (self._home - qpos)
        moved = gain * (posture + (inverse @ (error[:, :, None] - jacobian @ posture[:, :, None]))[:, :, 0])
        # a common factor for all joints keeps the direction of the tool's motion
        return qpos + moved / (moved / self.lead).abs().amax(dim=1, keepdim=True).clamp(min=1.0)

    def way_to(self, s: State, pose: Tensor) -> Tensor:
        """Return how far a pose is from the tool: x, y, z [m], then its shorter rotation, shape (num_envs, 6).

        The rotation is its axis times 2 sin(angle / 2), about the rotation vector of `move_tool` [rad].

        Args:
            s: The worlds.
            pose: Positions [m] and orientations (wxyz) in the frame of `tool`, such as `s.grasp("can")`.
        """
        return limited(pose, self.tool(s), (torch.inf, torch.pi), -torch.inf)[1]

    def tool_lead(self, s: State) -> Tensor:
        """Return the tool's target minus the tool's present pose: x, y, z [m] and yaw [rad], shape (num_envs, 4)."""
        return self.tool_target - self._tool_now(s)

    def grip(self, s: State, action: Tensor) -> None:
        """Set the gripper's target from -1 (closed) to 1 (open), shape (num_envs,).

        If the gripper's actuators are not position actuators, -1 and 1 are the ends of their control ranges.

        Raises:
            ArmError: The robot has no gripper.
        """
        self._gripper()
        s.ctrl[:, self._grip] = self._closed + self._half * (action[:, None] + 1.0)

    def _gripper(self) -> Fingers:
        if self._fingers is None:
            raise ArmError(
                f"{self._where}: the robot has no gripper: no actuator opens and closes a joint beyond the arm's last "
                "joint. Give a limited joint of the hand a position actuator, or another actuator with a 'ctrlrange'."
            )
        return self._fingers

    def _tool_now(self, s: State) -> Tensor:
        """Return position [m] and yaw [rad] of the tool, shape (num_envs, 4)."""
        pose = self.tool(s)
        yaw = rotations.yaw(pose[:, 3:])
        if self._base is not None:
            yaw = torch.remainder(yaw - self._facing(s) + torch.pi, 2.0 * torch.pi) - torch.pi
        return torch.cat([pose[:, :3], yaw[:, None]], dim=1)

    def _facing(self, s: State) -> Tensor:
        """Return the yaw of the robot's base [rad], shape (num_envs,). Only for scenes with several robots."""
        assert self._base is not None
        return rotations.yaw(s.pose(self._base)[:, 3:])

"""A scripted policy for demonstrations: follow the path to a grasp, close the gripper, and lift the object."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.reaching.poses import OPENING_MARGIN
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.vector import rotations
from sceniris_gym.vector.arm_controller import DAMPING, ArmController
from sceniris_gym.vector.task_worlds import memory_rows
from sceniris_gym.vector.torch_stream import on_torch_stream
from sceniris_gym.vector.vector_env import SceneVectorEnv

JOINT_SPEED, TOOL_SPEED, TURN_SPEED = 1.5, 0.4, 1.5
"""Greatest speeds on a path: of a joint [rad/s or m/s], and of the tool [m/s] and [rad/s]."""
GRASP_SPEED, LIFT_SPEED = 0.3, 0.4
"""Speeds of the tool between pre-grasp and grasp, and upwards [m/s]."""
ACCELERATING = 0.15
"""Time to reach full speed, and to stop [s]."""
APPROACH = 0.27
"""Greatest part of an episode for the way of a tool to the pre-grasp. It is faster on longer ways."""
TOLERANCE = 0.02
"""Distance between tool and path [m] at which the motion along the path stops. It slows down from the half on.

A rotation by 0.1 rad counts as 1 cm here and below.
"""
WAITING, ALIGNED = 0.1, 0.003
"""The arm rests in the pre-grasp until the tool is this close to it [m], but at most for this time [s]."""
SETTLING, CLOSING = 0.06, 0.24
"""The arm rests in the grasp before the gripper closes, and while it closes, for these times [s]."""
LIFT = 0.06
"""Height of the lifted tool, above the start of its path or, if this is higher, its pre-grasp [m]."""
OUT_OF_REACH = 0.01
"""While the tool is lifted and farther from where it should be [m], it also moves towards the start of its path."""

_SAMPLES = 16  # of each of the four pieces of a path
_PRE, _END = 3 * _SAMPLES, 4 * _SAMPLES  # the samples at the pre-grasp and at the grasp
_PROBE = 0.5  # the part of an action that is tried
_TURN_WEIGHT = 0.1  # [m/rad], small, because some actions cannot turn the tool about all axes
_REGULAR = 2e-6
# A quaternion times this matrix is rotated by half a turn about the approach axis.
_HALF_TURN = ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0))


def forward(arm: SerialArm, qpos: Tensor) -> Tensor:
    """Return the TCP's position [m] and orientation (wxyz) in the frame of the arm's base, shape (..., 7).

    Args:
        arm: The arm.
        qpos: Joint positions [rad or m], shape (..., joints).
    """
    constants = (arm.link_pos, arm.link_quat, arm.axis, arm.ref)
    links, quats, axes, ref = (torch.tensor(values, dtype=torch.float32, device=qpos.device) for values in constants)
    pos, quat = links[0].expand(*qpos.shape[:-1], 3), quats[0].expand(*qpos.shape[:-1], 4)
    for i, moved in enumerate((qpos - ref).unbind(dim=-1)):
        motion = axes[i] * moved[..., None]
        if arm.slide[i]:
            pos = pos + rotations.rotate(quat, motion)
        else:
            quat = rotations.multiply(quat, rotations.of_vector(motion))
        pos = pos + rotations.rotate(quat, links[i + 1].expand_as(pos))
        quat = rotations.multiply(quat, quats[i + 1])
    return torch.cat([pos, quat], dim=-1)


class Demonstrator:
    """A scripted policy: in each world, the arm follows the path to its target, grasps the target, and lifts it.

    In each step, the task's method `apply` is called with a part of each action, and the changes of the controls give
    their derivatives. The returned action is the least-squares solution for the wanted controls, clipped to [-1, 1]. If
    the actions can set all joints of the arm, the joints follow the path. Otherwise the tool follows it. If the actions
    cannot rotate the tool about all axes, its rotation is spread over the way, and is at most a quarter of a turn to
    the grasp or the grasp rotated by half a turn.

    Args:
        envs: The environment, with autoreset disabled.
        targets: Names of the objects to grasp, with `reachable: path`. If there are several, the task has a tensor
            `chosen`, shape (num_envs, len(targets)), with 1 for the object of each world.

    Raises:
        ArgumentError: The objects are reachable for different robots. The task has several targets and no `chosen`.
        ArmError: The robot lacks a gripper or position actuators.
    """

    def __init__(self, envs: SceneVectorEnv, targets: Sequence[str]) -> None:
        s, reaching, owners = envs.state, envs.compiled.reaching, envs.compiled.config.owners
        assert reaching is not None
        self._s, self._task, self._device, self._names = s, envs.task, envs.batch.device, targets
        targeted = list(enumerate(reaching.targets))
        self._columns = [[i for i, t in targeted if name in (t.name, owners.get(t.name))] for name in targets]
        arms = {reaching.targets[i].arm for columns in self._columns for i in columns}
        if len(arms) > 1:
            raise ArgumentError(f"demos: one robot should reach all of {', '.join(targets)}. Choose one by --target.")
        if len(targets) > 1 and not hasattr(envs.task, "chosen"):
            raise ArgumentError(f"demos: the task should have `chosen` for its targets {', '.join(targets)}.")
        self._one = reaching.arms[arms.pop()]
        self._arm, (most, least, *_) = ArmController(s, self._one.robot), self._one.gripper
        gaps = [
            torch.tensor([g.opening + OPENING_MARGIN for g in t.grasp_set.grasps], device=s.device) for _, t in targeted
        ]
        self._openings = [(2.0 * (gap - least) / (most - least) - 1.0).clamp(max=1.0) for gap in gaps]
        self._memory, self._size = [s.ctrl], envs.task.action_size or s.mjm.nu
        closed, opened = (self._gripped(torch.full((s.num_envs,), end, device=s.device)) for end in (-1.0, 1.0))
        self._grip = torch.where(opened != closed, 1.0 / (opened - closed), 0.0)
        self._memory += memory_rows({"task": envs.task}, s.num_envs).values()
        self._most = (envs.max_episode_steps or torch.inf) * APPROACH * s.dt
        self._lag = torch.tensor(self._arm._actuators.lag, dtype=torch.float32, device=s.device)
        self._weights = torch.tensor([[1.0]] * 3 + [[_TURN_WEIGHT]] * 3, device=s.device)
        self._eye = torch.eye(max(6, self._arm.joints, self._size), device=s.device)
        self._probe, self._slopes = _PROBE, torch.zeros(1, 1, 1, device=s.device)
        self._sets_joints, self._turns = False, True

    def start(self) -> None:
        """Plan the motions of new episodes. Call this method after a reset of all worlds. The first call waits."""
        s, n, device = self._s, self._s.num_envs, self._s.device
        rows, number = torch.arange(n, device=device), torch.zeros(n, dtype=torch.int64, device=device)
        if len(self._names) > 1:
            number = self._task.chosen.argmax(dim=1)  # pyrefly: ignore[missing-attribute]
        each = [[s.path(name)[0] for name in self._names], [self._opening(columns) for columns in self._columns]]
        corners, self._open = (torch.stack(values, dim=1)[rows, number] for values in each)
        if not self._slopes.any():
            self._find_modes()
        shares = torch.linspace(0.0, 1.0, _SAMPLES + 1, device=device)[1:, None]
        pieces = corners[:, :-1, None] + shares * (corners[:, 1:] - corners[:, :-1])[:, :, None]
        joints = torch.cat([corners[:, :1], pieces.flatten(1, 2)], dim=1)
        tool, first = self._arm.tool(s), forward(self._one.arm, self._arm.qpos(s))
        turn = rotations.multiply(tool[:, 3:], rotations.conjugate(first[:, 3:]))[:, None]
        own = forward(self._one.arm, joints)
        place = tool[:, None, :3] + rotations.rotate(turn, own[..., :3] - first[:, None, :3])
        quat, motion = rotations.multiply(turn, own[..., 3:]), (joints[:, 1:] - joints[:, :-1]).abs().amax(dim=2)
        if not self._turns:
            quat, motion = _spread(quat, motion.cumsum(dim=1)), torch.zeros_like(motion)
        pose = torch.cat([place, quat], dim=2)
        change = _between(pose[:, :-1], pose[:, 1:])
        change[..., :3] /= TOOL_SPEED
        change[:, _PRE:, :3] *= TOOL_SPEED / GRASP_SPEED
        moved, turned = change[..., :3].norm(dim=2), change[..., 3:].norm(dim=2)
        times = torch.maximum(torch.maximum(moved, turned / TURN_SPEED), motion / JOINT_SPEED)
        if not self._sets_joints:
            times[:, :_PRE] *= (self._most / times[:, :_PRE].sum(dim=1, keepdim=True)).clamp(max=1.0)
        self._times = torch.nn.functional.pad(times.cumsum(dim=1), (1, 0))
        self._samples = torch.cat([joints, pose], dim=2)
        self._aside, up = (place[:, 0] - place[:, _PRE]).tensor_split((2,), dim=1)
        self._lift = up[:, 0].clamp(min=0.0) + LIFT
        self._time, self._rate, self._wait, self._rest, self._rise, self._share = torch.zeros(6, n, device=device)
        self._up, self._wanted = torch.zeros_like(joints[:, 0]), self._samples[:, 0].clone()

    def act(self) -> Tensor:
        """Return the actions of the next step, shape (num_envs, size)."""
        s, arm, joints = self._s, self._arm, self._arm.joints
        with on_torch_stream(self._device):
            tool, qpos, jacobian = arm.tool(s), arm.qpos(s), s.jacobian(arm._tcp, arm.joint_ids)
            transposed = jacobian.transpose(1, 2)
            inverse = transposed @ torch.linalg.inv_ex(jacobian @ transposed + DAMPING * self._eye[:6, :6])[0]
            before, lifted = self._wanted, self._lifted()
            self._advance((self._weights[:, 0] * _between(tool, before[:, joints:])).norm(dim=1))
            self._up += rotations.transform(inverse[:, :, :3], self._lifted() - lifted)
            self._wanted = wanted = self._at(self._time)
            wanted[:, :joints] += self._up
            wanted[:, joints : joints + 3] += self._lifted()
            pose, weigh = wanted[:, joints:], self._weights * jacobian
            ways = [rotations.transform(inverse, _between(first, pose)) for first in (tool, before[:, joints:])]
            if self._sets_joints:
                weigh = self._eye[:joints, :joints]
                ways = [wanted[:, :joints] - first for first in (qpos, before[:, :joints])]
            aim = rotations.transform(weigh, ways[0] + self._lag / s.dt * ways[1] + arm._actuators.bearing(s))
            gripped = self._gripped(torch.where(self._rest > SETTLING, -1.0, self._open))
            slopes, offset = self._derivatives(weigh)
            left = torch.cat([aim, gripped * self._grip], dim=1) - offset
            normal = slopes @ slopes.transpose(1, 2) + _REGULAR * self._eye[: self._size, : self._size]
            return rotations.transform(torch.linalg.inv_ex(normal)[0] @ slopes, left).clamp(-1.0, 1.0)

    def _advance(self, off: Tensor) -> None:
        """Advance the plan by a step, for tools that are `off` their paths [m], shape (num_envs,)."""
        dt, pre, back = self._s.dt, self._times[:, _PRE], self._rest >= SETTLING + CLOSING
        self._wait += dt * (self._time >= pre)
        aligned = (self._wait > WAITING) | ((self._wait > 0.0) & (off < ALIGNED))
        self._wait += aligned
        left = torch.where(aligned & ~back, self._times[:, _END], pre) - self._time
        rise = torch.where(back, self._lift - self._rise, 0.0) / LIFT_SPEED
        far = left.abs() + rise
        self._rest += dt * (aligned & (far < 1e-6))
        slowed = (2.0 - 2.0 * off / TOLERANCE).clamp(0.0, 1.0)
        most = torch.minimum(slowed, (2.0 / ACCELERATING * far).sqrt() + 0.01)
        self._rate = torch.minimum(self._rate + dt / ACCELERATING, most)
        step = dt * self._rate
        moved = left.clamp(-step, step)
        self._time += moved
        self._rise += LIFT_SPEED * torch.minimum(step - moved.abs(), rise)
        self._share += dt * ((off > OUT_OF_REACH) & (self._rise > 0.0) & (self._share < 1.0))

    def _at(self, time: Tensor) -> Tensor:
        """Return the joints and the pose of the tool on the path at a time [s], shape (num_envs, joints + 7)."""
        i = torch.searchsorted(self._times, time[:, None], right=True).clamp(1, _END)
        early, late = self._times.gather(1, i - 1), self._times.gather(1, i)
        share = ((time[:, None] - early) / (late - early).clamp(min=1e-9)).clamp(0.0, 1.0)
        rows = torch.arange(len(time), device=time.device)
        return torch.lerp(self._samples[rows, i[:, 0] - 1], self._samples[rows, i[:, 0]], share)

    def _lifted(self) -> Tensor:
        """Return how far the tool is from the pre-grasp while the object is lifted [m], shape (num_envs, 3)."""
        return torch.cat([self._share[:, None] * self._aside, self._rise[:, None]], dim=1)

    def _opening(self, columns: Sequence[int]) -> Tensor:
        """Return how far the gripper opens on the path, from -1 to 1, shape (num_envs,)."""
        opening = torch.ones(self._s.num_envs, device=self._s.device)
        for i in columns:
            grasp = self._s._layouts.grasp[:, i].long()
            opening = torch.where(grasp < 0, opening, self._openings[i][grasp.clamp(min=0)])
        return opening

    def _gripped(self, opening: Tensor) -> Tensor:
        """Return controls that open the gripper, from -1 (closed) to 1 (open), shape (num_envs, nu)."""
        with self._undone():
            self._arm.grip(self._s, opening)
            return self._s.ctrl.clone()

    def _find_modes(self) -> None:
        """Find whether the actions set all joints, and whether they turn the tool about all axes. Waits."""
        slopes, _ = self._derivatives(self._eye[: self._arm.joints, : self._arm.joints])
        moved, jacobian = slopes[0, :, : self._arm.joints], self._s.jacobian(self._arm._tcp, self._arm.joint_ids)[0]
        joints, tool = (int(torch.linalg.matrix_rank(each, atol=1e-5)) for each in (moved, moved @ jacobian.T))
        self._sets_joints, self._turns = joints == self._arm.joints, joints == self._arm.joints or tool == 6
        self._slopes = torch.zeros_like(self._slopes[:, :, :1])

    @contextmanager
    def _undone(self) -> Iterator[None]:
        """Restore the controls and the memory of the task after the block."""
        kept = [tensor.clone() for tensor in self._memory]
        yield
        for tensor, values in zip(self._memory, kept, strict=True):
            tensor.copy_(values)

    def _derivatives(self, weigh: Tensor) -> tuple[Tensor, Tensor]:
        """Return derivatives of the weighted targets and of the gripper's controls, and both without action.

        At a limit, an action may have no effect in one direction, so the sign of the tried actions alternates. The
        steeper one of the latest two derivatives counts.

        Args:
            weigh: Weights of joint targets less joints, shape (rows, joints) or (num_envs, rows, joints).

        Returns:
            Shapes (num_envs, size, rows + nu) and (num_envs, rows + nu).
        """
        s, size, found = self._s, self._size, []
        for action in (torch.zeros_like(self._eye[0, :size]), *(self._probe * self._eye[:size, :size])):
            with self._undone():
                self._task.apply(s, action.expand(s.num_envs, -1))
                moved = rotations.transform(weigh, self._arm.targets(s) - self._arm.qpos(s))
                found.append(torch.cat([moved, s.ctrl * self._grip], dim=1))
        slopes = (torch.stack(found[1:], dim=1) - found[0][:, None]) / self._probe
        older, self._slopes, self._probe = self._slopes, slopes, -self._probe
        return torch.where(slopes.norm(dim=2, keepdim=True) < older.norm(dim=2, keepdim=True), older, slopes), found[0]


def _spread(quat: Tensor, way: Tensor) -> Tensor:
    """Spread the rotation to the grasp, or to the grasp rotated by half a turn, over the way to the pre-grasp.

    Args:
        quat: Orientations of the tool on a path (wxyz), shape (n, samples, 4).
        way: Length of the path up to each sample after the first, shape (n, samples - 1).
    """
    ends = torch.stack([quat[:, -1], quat[:, -1] @ quat.new_tensor(_HALF_TURN)], dim=1)
    near = (ends * quat[:, :1]).sum(dim=2)
    best = near.abs().argmax(dim=1, keepdim=True)
    last = ends.gather(1, best[:, :, None].expand(-1, -1, 4)) * near.gather(1, best).sign()[:, :, None]
    share = torch.nn.functional.pad(way / way[:, _PRE - 1, None], (1, 0)).clamp(max=1.0)[:, :, None]
    return torch.nn.functional.normalize(torch.lerp(quat[:, :1], last, share), dim=2)


def _between(first: Tensor, second: Tensor) -> Tensor:
    """Return the motion from poses to other poses (..., 7): x, y, z [m] and the shorter rotation [rad], (..., 6)."""
    quat = rotations.multiply(second[..., 3:], rotations.conjugate(first[..., 3:]))
    return torch.cat([second[..., :3] - first[..., :3], 2.0 * rotations.shorter(quat)], dim=-1)

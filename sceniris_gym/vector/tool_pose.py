"""Target poses of a robot's tool: changed by six numbers, and limited to a distance from the tool."""

import math
from typing import Literal, get_args

import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.vector import rotations

Frame = Literal["base", "tool"]
"""The frame whose axes a change of a pose has: the base frame, or the frame of the pose before the change."""

Lead = tuple[float, float]
"""Largest distance along an axis of the base frame [m], and largest angle [rad], below pi."""


def check_action(action: Tensor, numbers: tuple[int, ...], frame: str, where: str) -> None:
    """Check an action that moves an arm: how many numbers it has for each world, and their frame.

    Raises:
        ArgumentError: The action has another shape, `frame` is not a Frame, or `frame` is "tool" for four numbers.
    """
    if action.ndim != 2 or action.shape[1] not in numbers:
        shapes = " or ".join(f"(num_envs, {n})" for n in numbers)
        raise ArgumentError(f"{where}: action should have shape {shapes}, got {tuple(action.shape)}.")
    if frame not in get_args(Frame) or (frame == "tool" and action.shape[1] == 4):
        raise ArgumentError(f"{where}: frame should be 'base', or 'tool' for six numbers, got {frame!r}.")


def changed(pose: Tensor, change: Tensor, frame: Frame) -> Tensor:
    """Return poses after a change, shape (num_envs, 7).

    Args:
        pose: Positions [m] and orientations (wxyz) in the base frame, shape (num_envs, 7).
        change: Change of the position [m], and a rotation vector [rad], shape (num_envs, 6).
        frame: The frame of `change`.
    """
    (position, quat), (shift, vector) = pose.split((3, 4), dim=1), change.split((3, 3), dim=1)
    turn = rotations.of_vector(vector)
    if frame == "tool":
        return torch.cat([position + rotations.rotate(quat, shift), rotations.multiply(quat, turn)], dim=1)
    return torch.cat([position + shift, rotations.multiply(turn, quat)], dim=1)


def limited(target: Tensor, now: Tensor, lead: Lead, lowest: float) -> tuple[Tensor, Tensor]:
    """Limit target poses to a distance from the tool. Return the limited poses, and how far they are ahead.

    Args:
        target: Positions [m] and orientations (wxyz) in the base frame, shape (num_envs, 7).
        now: The tool's poses, in the same form.
        lead: Limits of the distance and the angle.
        lowest: Lower limit of the target's z [m].

    Returns:
        The limited poses, shape (num_envs, 7), and their differences from `now`, shape (num_envs, 6): of the positions
        [m], and the axis times 2 sin(angle / 2) of the shorter rotation, about the rotation vector [rad].
    """
    place = target[:, :3].clamp(now[:, :3] - lead[0], now[:, :3] + lead[0])
    place[:, 2].clamp_(min=lowest)
    axis = rotations.shorter(rotations.multiply(target[:, 3:], rotations.conjugate(now[:, 3:])))
    axis = axis / (axis.norm(dim=1, keepdim=True) / math.sin(0.5 * lead[1])).clamp(min=1.0)
    scalar = (1.0 - axis.square().sum(dim=1, keepdim=True)).sqrt()
    quat = rotations.multiply(torch.cat([scalar, axis], dim=1), now[:, 3:])
    return torch.cat([place, quat], dim=1), torch.cat([place - now[:, :3], 2.0 * axis], dim=1)

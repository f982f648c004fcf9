"""Target poses against the arithmetic of SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from sceniris_gym.errors import ArgumentError
from sceniris_gym.vector.tool_pose import Frame, changed, check_action, limited

POSES = 50


def drawn(seed: int) -> tuple[torch.Tensor, np.ndarray, Rotation]:
    """Return poses in float64, and their positions and rotations for SciPy."""
    rng = np.random.default_rng(seed)
    positions, rotations = rng.uniform(-1.0, 1.0, (POSES, 3)), Rotation.random(POSES, rng=rng)
    return torch.as_tensor(np.hstack([positions, rotations.as_quat(scalar_first=True)])), positions, rotations


def rotation_of(pose: torch.Tensor) -> Rotation:
    """Return the rotations of poses."""
    return Rotation.from_quat(pose[:, 3:].numpy(), scalar_first=True)


def test_a_pose_changes_along_the_axes_of_the_base_or_its_own():
    """By rotation vectors of all lengths, 0 and beyond pi included."""
    pose, positions, rotations = drawn(0)
    change = np.random.default_rng(1).uniform(-1.0, 1.0, (POSES, 6)) * np.linspace(0.0, 4.0, POSES)[:, None]
    shift, turn = change[:, :3], Rotation.from_rotvec(change[:, 3:])
    frames: dict[Frame, tuple[np.ndarray, Rotation]] = {
        "base": (positions + shift, turn * rotations),
        "tool": (positions + rotations.apply(shift), rotations * turn),
    }
    for frame, (moved, turned) in frames.items():
        found = changed(pose, torch.as_tensor(change), frame)
        np.testing.assert_allclose(found[:, :3], moved, atol=1e-12)
        np.testing.assert_allclose(rotation_of(found).as_matrix(), turned.as_matrix(), atol=1e-12)


def test_a_target_is_ahead_of_the_tool_by_the_lead_at_most():
    """Along each axis of the base, and about the axis of the shorter rotation; not below the lowest height."""
    now, positions, rotations = drawn(2)
    way = Rotation.from_rotvec(np.random.default_rng(3).normal(size=(POSES, 3)) * np.linspace(0.0, 2.0, POSES)[:, None])
    target, goals, _ = drawn(4)
    target[:, 3:] = torch.as_tensor((way * rotations).as_quat(scalar_first=True))
    found, error = limited(target, now, (0.3, 0.5), -0.2)
    expected = np.clip(goals, positions - 0.3, positions + 0.3)
    expected[:, 2] = np.maximum(expected[:, 2], -0.2)
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-12)
    vector = way.as_rotvec()
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    short = np.minimum(angle, 0.5)
    assert (angle < 0.5).any()
    assert (angle > 0.5).any()
    axis = vector / np.maximum(angle, 1e-12)
    turned = Rotation.from_rotvec(short * axis) * rotations
    np.testing.assert_allclose(rotation_of(found).as_matrix(), turned.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(error[:, :3], expected - positions, atol=1e-12)
    np.testing.assert_allclose(error[:, 3:], 2.0 * np.sin(0.5 * short) * axis, atol=1e-9)


@pytest.mark.parametrize(
    ("shape", "frame", "message"),
    [
        ((2, 5), "base", r"here: action should have shape \(num_envs, 4\) or \(num_envs, 6\), got \(2, 5\)."),
        ((6,), "base", r"here: action should have shape .*, got \(6,\)."),
        ((2, 6), "hand", "here: frame should be 'base', or 'tool' for six numbers, got 'hand'."),
        ((2, 4), "tool", "here: frame should be 'base', or 'tool' for six numbers, got 'tool'."),
    ],
)
def test_an_action_of_another_form_is_refused(shape, frame, message):
    """With the shape or the frame that it should have."""
    with pytest.raises(ArgumentError, match=message):
        check_action(torch.zeros(shape), (4, 6), frame, "here")

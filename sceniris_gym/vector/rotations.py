"""Quaternions as MuJoCo has them (w, x, y, z), in batched torch operations."""

import torch
from torch import Tensor


def conjugate(quat: Tensor) -> Tensor:
    """Return the inverse rotation of unit quaternions wxyz, shape (..., 4)."""
    return torch.cat([quat[..., :1], -quat[..., 1:]], dim=-1)


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """Return the rotation `right` followed by `left`; wxyz, shapes (..., 4) that broadcast."""
    w1, x1, y1, z1 = left.unbind(-1)
    w2, x2, y2, z2 = right.unbind(-1)
    return torch.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        dim=-1,
    )


def rotate(quat: Tensor, vector: Tensor) -> Tensor:
    """Rotate vectors, shape (..., 3), by unit quaternions wxyz, shape (..., 4)."""
    w, axis = quat[..., :1], quat[..., 1:].expand(*vector.shape[:-1], 3)
    twice = 2.0 * torch.linalg.cross(axis, vector.expand_as(axis))
    return vector + w * twice + torch.linalg.cross(axis, twice)

"""Quaternions in MuJoCo's order (w, x, y, z), with few torch operations, because each operation launches a kernel."""

import functools

import torch
from torch import Tensor

PARTNER = [[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]]
SIGN = [[1, -1, -1, -1], [1, 1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1]]
"""Hamilton's product: component k is the sum over j of SIGN[k][j] * left[j] * right[PARTNER[k][j]]."""


def conjugate(quat: Tensor) -> Tensor:
    """Return the inverse rotation of unit quaternions wxyz, shape (..., 4)."""
    return torch.cat([quat[..., :1], -quat[..., 1:]], dim=-1)


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """Return the product `left` times `right`, which rotates by `right` first, wxyz. Shapes (..., 4) broadcast."""
    partner, sign = _product(right.device)
    return transform(sign * right[..., partner], left)


def of_vector(vector: Tensor) -> Tensor:
    """Return the unit quaternions wxyz of rotation vectors [rad], shape (..., 3): about the vector, by its length."""
    half = 0.5 * vector.norm(dim=-1, keepdim=True)
    return torch.cat([half.cos(), 0.5 * torch.sinc(half / torch.pi) * vector], dim=-1)


def shorter(quat: Tensor) -> Tensor:
    """Return the axes of rotations times sin(angle / 2), for the shorter way, shape (..., 3).

    The quaternions q and -q are the same rotation, and a positive scalar part means the shorter way.
    """
    return quat[..., 1:] * torch.where(quat[..., :1] < 0.0, -1.0, 1.0)


def rotate(quat: Tensor, vector: Tensor) -> Tensor:
    """Rotate vectors, shape (..., 3), by unit quaternions wxyz, shape (..., 4).

    A vector v becomes v + 2 (w (u x v) + u x (u x v)), with w the scalar part and u the vector part of the quaternion.
    """
    w, axis = quat[..., :1], quat[..., 1:].expand(*vector.shape[:-1], 3)
    turned = torch.linalg.cross(axis, vector.expand_as(axis))
    return vector.add(torch.addcmul(torch.linalg.cross(axis, turned), w, turned), alpha=2.0)


def transform(matrix: Tensor, vector: Tensor) -> Tensor:
    """Return matrix times vector. Shapes (..., n, m) and (..., m) broadcast.

    The products are summed in full precision. If a user has enabled TF32, torch's matrix product is less precise.
    """
    return (matrix * vector.unsqueeze(-2)).sum(dim=-1)


@functools.cache
def _product(device: torch.device) -> tuple[Tensor, Tensor]:
    # tensors that are made under inference mode cannot take part in gradients
    with torch.inference_mode(False):
        return torch.tensor(PARTNER, device=device), torch.tensor(SIGN, dtype=torch.float32, device=device)


def yaw(quat: Tensor) -> Tensor:
    """Return the angle by which a rotation turns the x axis about the vertical [rad], shape (...,)."""
    w, x, y, z = quat.unbind(dim=-1)
    return torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def axes(quat: Tensor) -> Tensor:
    """Return the x axis, then the z axis of rotated frames, shape (..., 6).

    The axes are a continuous function of the rotation, unlike quaternions, where q and -q are the same rotation (Zhou
    et al., "On the Continuity of Rotation Representations in Neural Networks", 2019).
    """
    w, x, y, z = quat.unbind(dim=-1)
    first = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
    last = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    return torch.stack([*first, *last], dim=-1)

"""Batched forward kinematics on the device."""

import numpy as np
import warp as wp

from sceniris_gym.device.quaternions import z_axis
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import ArmView, arm_view, as_vec8, forward, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _tcp_axes(
    # Arm:
    arm: ArmView,
    # In:
    joints: wp.array[vec8],
    # Out:
    pos_out: wp.array[wp.vec3],
    approach_out: wp.array[wp.vec3],
):
    poseid = wp.tid()
    pos, quat = forward(arm, joints[poseid])
    pos_out[poseid] = pos
    approach_out[poseid] = z_axis(quat)


def tcp_axes(arm: SerialArm, joints: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return TCP positions [m] and unit approach axes in the base frame, each (N, 3), of joints (N, njoint)."""
    with wp.ScopedDevice(device):
        pos, approach = wp.zeros(len(joints), dtype=wp.vec3), wp.zeros(len(joints), dtype=wp.vec3)
        q = wp.array(as_vec8(joints), dtype=vec8)
        wp.launch(_tcp_axes, dim=len(joints), inputs=[arm_view(arm, device), q], outputs=[pos, approach])
        return pos.numpy(), approach.numpy()

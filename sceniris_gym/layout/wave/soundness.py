"""The last check of a layout before it is served: finite, within the scene's bounds, with unit quaternions.

Checks on the host refuse all known ways to such layouts; this one guards against the unknown.
"""

import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.device import Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Single precision keeps the squared norm of a quaternion to a few times 1e-7.
_UNIT = wp.constant(1.0e-4)


@wp.func
def _is_unit(w: float, x: float, y: float, z: float) -> bool:
    # nan compares as false
    return wp.abs(w * w + x * x + y * y + z * z - 1.0) <= _UNIT


@wp.func
def is_sound(program: Program, layouts: LayoutsView, row: int, lane: int, lanes: int) -> bool:
    """Return True if a row may be served, as far as lane `lane` of `lanes` looks."""
    for i in range(lane, layouts.qpos.shape[1], lanes):
        if not (wp.abs(layouts.qpos[row, i]) <= program.bound_qpos[i]):
            return False
    for i in range(lane, program.quat_qposadr.shape[0], lanes):
        adr = program.quat_qposadr[i]
        qpos = layouts.qpos[row]
        if not _is_unit(qpos[adr], qpos[adr + 1], qpos[adr + 2], qpos[adr + 3]):
            return False
    for i in range(lane, program.bound_mocap.shape[0], lanes):
        pos = layouts.mocap_pos[row, i]
        far = wp.abs(pos[0]) + wp.abs(pos[1]) + wp.abs(pos[2])  # a maximum would ignore nan
        q = layouts.mocap_quat[row, i]
        if not (far <= program.bound_mocap[i]) or not _is_unit(q[0], q[1], q[2], q[3]):
            return False
    return True

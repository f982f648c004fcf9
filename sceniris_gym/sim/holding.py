"""Controls and activations that hold a pose, in worlds whose gains differ."""

from __future__ import annotations

import mujoco_warp as mjw
import warp as wp

from sceniris_gym.sim.rest import RestMap, rest_value

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GAINS = ("actuator_gainprm", "actuator_biasprm", "actuator_gear")
"""Fields that these controls follow from."""


@wp.func
def _follow(values: wp.array[float], at: int, before: float, now: float):
    """Replace a control that held the pose, but for rounding."""
    if wp.abs(values[at] - before) <= 1.0e-6 * wp.max(1.0, wp.abs(before)):
        values[at] = now


@wp.kernel
def _hold_anew(
    mask: wp.array[wp.bool],
    rest: RestMap,
    # Model in:
    actuator_gainprm: wp.array3d[float],
    actuator_biasprm: wp.array3d[float],
    actuator_gear: wp.array2d[wp.spatial_vector],
    # Data in:
    qpos: wp.array2d[float],
    # Data out:
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
    history_out: wp.array2d[float],
    # Out:
    law_out: wp.array2d[wp.vec2],
):
    worldid, element = wp.tid()
    actuatorid = rest.actuator[element]
    if not mask[worldid] or actuatorid < 0:
        return
    before = rest_value(rest, worldid, element, qpos[worldid])
    gain = actuator_gainprm[worldid % actuator_gainprm.shape[0], actuatorid, 0]
    bias0 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 0]
    bias1 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 1]
    gear = actuator_gear[worldid % actuator_gear.shape[0], actuatorid][0]
    if gain * bias1 >= 0.0:
        return
    law_out[worldid, element] = wp.vec2(-bias0 / gain, -bias1 / gain * gear)
    now = rest_value(rest, worldid, element, qpos[worldid])
    # controls that hold the present pose follow; those that somebody else has set stay
    nu = ctrl_out.shape[1]
    if element < nu:
        _follow(ctrl_out[worldid], element, before, now)
    else:
        _follow(act_out[worldid], element - nu, before, now)
    for k in range(rest.sampleadr.shape[0]):
        if rest.sampled[k] == element:
            _follow(history_out[worldid], rest.sampleadr[k], before, now)


def launch_holding(rest: RestMap, m: mjw.Model, d: mjw.Data, mask: wp.array) -> None:
    """Find the controls and activations that hold a pose; those that hold the present one are set anew.

    Args:
        rest: The controls at rest, with a row for each world.
        m: The Model; its present arrays are used in place.
        d: Data of the worlds.
        mask: Which worlds, shape (nworld,), bool.
    """
    gains = [m.actuator_gainprm.view(wp.float32), m.actuator_biasprm.view(wp.float32), m.actuator_gear]
    outputs = [d.ctrl, d.act, getattr(d, "history", None), rest.law]
    dim = d.nworld, rest.actuator.shape[0]
    wp.launch(_hold_anew, dim, inputs=[mask, rest, *gains, d.qpos], outputs=outputs, device=mask.device)

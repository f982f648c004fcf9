"""Fills the control histories of delayed actuators with the controls that a reset wrote."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.sim.versions import actuator_controls

wp.set_module_options({"enable_backward": False})


def history_samples(mjm: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return where controls are kept in `history`: addresses in it, and the control of each, both (n,) int32.

    An actuator with n samples of m controls has there, one after the other: two numbers, n times, and n x m controls.
    """
    ctrladr, ctrlnum = actuator_controls(mjm)
    address, control = [], []
    for i, (nsample, _) in enumerate(mjm.actuator_history):
        first = mjm.actuator_historyadr[i] + 2 + nsample
        for k in range(nsample * ctrlnum[i] if nsample > 0 else 0):
            address.append(first + k)
            control.append(ctrladr[i] + k % ctrlnum[i])
    return np.array(address, np.int32), np.array(control, np.int32)


@wp.kernel
def _fill_histories(
    address: wp.array[int],
    control: wp.array[int],
    mask: wp.array[wp.bool],
    ctrl: wp.array2d[float],
    history_out: wp.array2d[float],
):
    worldid, k = wp.tid()
    if mask[worldid]:
        history_out[worldid, address[k]] = ctrl[worldid, control[k]]


class ControlHistory:
    """Past controls of actuators with a delay, as if the present ones had been there for ever.

    Args:
        mjm: The model.
        device: The device of the data.
        controls: The controls whose past is filled; all if None.
    """

    def __init__(self, mjm: mujoco.MjModel, device: wp.Device, controls: np.ndarray | None = None) -> None:
        address, control = history_samples(mjm)
        if controls is not None:
            wanted = np.isin(control, controls)
            address, control = address[wanted], control[wanted]
        self._address = wp.array(address, dtype=wp.int32, device=device)
        self._control = wp.array(control, dtype=wp.int32, device=device)

    def launch_fill(self, d: mjw.Data, mask: wp.array) -> None:
        """Fill the histories of the worlds in `mask`, shape (nworld,), bool, with their `ctrl`."""
        number = self._address.shape[0]
        if number > 0:
            inputs = [self._address, self._control, mask, d.ctrl]
            wp.launch(_fill_histories, (d.nworld, number), inputs=inputs, outputs=[d.history], device=mask.device)

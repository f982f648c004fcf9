"""`VariantReader`: turns simulated worlds into rows of layouts, which have a body for each variant of an object."""

from __future__ import annotations

import mujoco_warp as mjw
import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.device import copied
from sceniris_gym.sim.variants import LANES, VariantWriter, is_absent

wp.set_module_options({"enable_backward": False})

_FAR = 1.0e6  # coordinates of absent variants [m], beyond the origin of any world


@wp.kernel
def _read_worlds(
    # Places:
    slot_kind: wp.array[wp.vec2i],
    qpos_kind: wp.array[wp.vec2i],
    mocap_kind: wp.array[wp.vec2i],
    qpos_adr: wp.array[int],
    mocap_adr: wp.array[int],
    # In:
    variant: wp.array2d[int],
    present_in: wp.array2d[int],
    qpos_in: wp.array2d[float],
    mocap_pos_in: wp.array2d[wp.vec3],
    mocap_quat_in: wp.array2d[wp.quat],
    mask: wp.array[wp.bool],
    # Out:
    present_out: wp.array2d[int],
    qpos_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    for i in range(lane, slot_kind.shape[0], wp.block_dim()):
        present_out[worldid, i] = present_in[worldid, i]
        if slot_kind[i][0] >= 0:
            present_out[worldid, i] = wp.where(is_absent(slot_kind[i], variant[worldid]), 0, 1)
    for i in range(lane, qpos_adr.shape[0], wp.block_dim()):
        qpos_out[worldid, i] = qpos_in[worldid, qpos_adr[i]]
        if is_absent(qpos_kind[i], variant[worldid]):
            qpos_out[worldid, i] = wp.static(_FAR)
    for i in range(lane, mocap_adr.shape[0], wp.block_dim()):
        mocap_pos_out[worldid, i] = mocap_pos_in[worldid, mocap_adr[i]]
        mocap_quat_out[worldid, i] = mocap_quat_in[worldid, mocap_adr[i]]
        if is_absent(mocap_kind[i], variant[worldid]):
            mocap_pos_out[worldid, i] = wp.vec3(wp.static(_FAR))


class VariantReader:
    """Reads simulated worlds as rows of layouts, in which absent variants are far away.

    Args:
        d: Data of the worlds; its arrays are used in place.
        variants: The writer of the variants that worlds have.
        layouts: The layouts that worlds were reset to, which say who else is present.

    Attributes:
        state: The worlds: `layouts` with arrays of its own for `present`, `qpos`, `mocap_pos` and `mocap_quat`.
    """

    def __init__(self, d: mjw.Data, variants: VariantWriter, layouts: LayoutsView) -> None:
        self._device, self._nworld, self.state = d.qpos.device, d.nworld, copied(LayoutsView, layouts)
        self._inputs = [*variants.places, variants.variant, layouts.present, d.qpos, d.mocap_pos, d.mocap_quat]
        self._outputs = []
        for name in ("present", "qpos", "mocap_pos", "mocap_quat"):
            setattr(self.state, name, wp.zeros_like(getattr(layouts, name)))
            self._outputs.append(getattr(self.state, name))

    def launch(self, mask: wp.array) -> None:
        """Read the masked worlds, shape (nworld,), bool."""
        words = {"inputs": [*self._inputs, mask], "outputs": self._outputs, "block_dim": LANES}
        wp.launch_tiled(_read_worlds, dim=[self._nworld], **words, device=self._device)

"""`VariantReader`: turns simulated worlds into rows of layouts, which have a body for each variant of an object."""

from __future__ import annotations

import mujoco_warp as mjw
import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.device import copied
from sceniris_gym.sim.variants import LANES, Places, VariantWriter, is_absent
from sceniris_gym.sim.write import Poses, poses_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FAR = 1.0e6  # coordinates of absent variants [m], beyond the origin of any world


@wp.kernel
def _read_worlds(
    places: Places,
    # In:
    variant: wp.array2d[int],
    present_in: wp.array2d[int],
    # Poses in: qpos, mocap_pos, mocap_quat
    poses: Poses,
    mask: wp.array[wp.bool],
    # Layouts out: qpos, mocap_pos, mocap_quat, present
    layouts_out: LayoutsView,
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    for i in range(lane, places.slot_kind.shape[0], wp.block_dim()):
        layouts_out.present[worldid, i] = present_in[worldid, i]
        if places.slot_kind[i][0] >= 0:
            layouts_out.present[worldid, i] = wp.where(is_absent(places.slot_kind[i], variant[worldid]), 0, 1)
    for i in range(lane, places.qpos_adr.shape[0], wp.block_dim()):
        layouts_out.qpos[worldid, i] = poses.qpos[worldid, places.qpos_adr[i]]
        if is_absent(places.qpos_kind[i], variant[worldid]):
            layouts_out.qpos[worldid, i] = wp.static(_FAR)
    for i in range(lane, places.mocap_adr.shape[0], wp.block_dim()):
        layouts_out.mocap_pos[worldid, i] = poses.mocap_pos[worldid, places.mocap_adr[i]]
        layouts_out.mocap_quat[worldid, i] = poses.mocap_quat[worldid, places.mocap_adr[i]]
        if is_absent(places.mocap_kind[i], variant[worldid]):
            layouts_out.mocap_pos[worldid, i] = wp.vec3(wp.static(_FAR))


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
        self._inputs = [variants.places, variants.variant, layouts.present, poses_of(d)]
        for name in ("present", "qpos", "mocap_pos", "mocap_quat"):
            setattr(self.state, name, wp.zeros_like(getattr(layouts, name)))

    def launch(self, mask: wp.array) -> None:
        """Read the masked worlds, shape (nworld,), bool."""
        words = {"inputs": [*self._inputs, mask], "outputs": [self.state], "block_dim": LANES}
        wp.launch_tiled(_read_worlds, dim=[self._nworld], **words, device=self._device)

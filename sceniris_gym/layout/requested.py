"""`RequestedLayouts`: the layouts of any seeds and episodes, as a function of these alone."""

from __future__ import annotations

import warp as wp

from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.program.compiled import CompiledScene

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _hand_over(
    home_qpos: wp.array[float],
    home_pos: wp.array[wp.vec3],
    home_quat: wp.array[wp.quat],
    mask: wp.array[wp.bool],
    # Layouts in: qpos, mocap_pos, mocap_quat, status
    layouts: LayoutsView,
    # Out:
    qpos_out: wp.array2d[float],
    pos_out: wp.array2d[wp.vec3],
    quat_out: wp.array2d[wp.quat],
    fallback_out: wp.array[wp.bool],
):
    worldid, i = wp.tid()
    asked = mask[worldid]
    if i == 0:
        fallback_out[worldid] = asked and layouts.status[worldid] == Status.FALLBACK
    if i < qpos_out.shape[1]:
        qpos_out[worldid, i] = layouts.qpos[worldid, i] if asked else home_qpos[i]
    if i < pos_out.shape[1]:
        pos_out[worldid, i] = layouts.mocap_pos[worldid, i] if asked else home_pos[i]
        quat_out[worldid, i] = layouts.mocap_quat[worldid, i] if asked else home_quat[i]


class RequestedLayouts(StaysHere):
    """Layouts by their seeds and episodes. Unlike a generator's, they do not depend on earlier calls.

    Args:
        compiled: The scene.
        nworld: Number of layouts in a call.
        split: "train" or "eval", which share no layouts.

    Raises:
        ScenirisError: As `LayoutGenerator`.
    """

    SEND = "the CompiledScene, and make new ones there"

    @launching
    def __init__(self, compiled: CompiledScene, nworld: int, split: str = "train") -> None:
        self._generator = LayoutGenerator(compiled, nworld, split=split)
        layouts = self._generator.layouts
        self._home = [wp.clone(array[0]) for array in (layouts.qpos, layouts.mocap_pos, layouts.mocap_quat)]
        self._generator.generate(wp.zeros(nworld, dtype=wp.bool, device=compiled.device))  # records its graph
        wp.synchronize_device(compiled.device)  # the streams of later launches do not wait for this one

    @launching
    def launch(self, seed: wp.array, episode: wp.array, mask: wp.array, *outputs: wp.array) -> None:
        """Write the layouts of the masked rows, and the start pose into the others, on the current stream.

        Args:
            seed: The low and the high 32 bits of each seed, shape (nworld, 2), uint32.
            episode: Episodes from 0 on, shape (nworld,), int32.
            mask: Rows that get a layout, shape (nworld,), bool.
            *outputs: Joint positions [m, rad], quaternions wxyz, shape (nworld, nq); positions of mocap bodies [m],
                shape (nworld, nmocap), vec3; their orientations, wxyz inside `wp.quat`, shape (nworld, nmocap); and
                the rows whose layout came from the bank, shape (nworld,), bool.
        """
        generator, view, device = self._generator, self._generator.layouts.view, mask.device
        seeds = wp.array(ptr=seed.ptr, dtype=wp.uint64, shape=generator.nworld, device=device)
        generator.launch_reseed(seeds, None, episode)
        generator.generate(mask)
        dim = (generator.nworld, max(outputs[0].shape[1], outputs[1].shape[1], 1))
        wp.launch(_hand_over, dim, inputs=[*self._home, mask, view], outputs=list(outputs), device=device)

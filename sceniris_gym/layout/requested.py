"""`RequestedLayouts`: the layouts of any seeds and episodes, as a function of these alone."""

from __future__ import annotations

import warp as wp

from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene

PARTS = ("qpos", "mocap_pos", "mocap_quat", "status")
"""The arrays of layouts that are written."""


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
        self._parts = [getattr(self._generator.layouts, name) for name in PARTS]
        self._start = [wp.clone(part) for part in self._parts]
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
                the `Status` of each layout, NONE for the start pose, shape (nworld,), int32.
        """
        generator = self._generator
        seeds = wp.array(ptr=seed.ptr, dtype=wp.uint64, shape=generator.nworld, device=mask.device)
        generator.launch_reseed(seeds, None, episode)
        for part, start in zip(self._parts, self._start, strict=True):
            wp.copy(part, start)
        generator.generate(mask)
        for part, output in zip(self._parts, outputs, strict=True):
            if output.size > 0:  # without mocap bodies layouts have an unused one
                wp.copy(output, part)

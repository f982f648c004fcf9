"""Sizes of a search, and all that a generator makes with one: the sizes must not change a bit of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.search import SearchSize, default_size
from sceniris_gym.program.compiled import CompiledScene

# busy, candidates, rows, lanes
_SIZES = (
    (1, 3, 0, 1),
    (1, 64, 5, 3),
    (7, 3, 100, 1),
    (7, 512, 0, 3),
    (64, 3, 5, 3),
    (64, 64, 100, 1),
    (64, 512, 100, 3),
    (4096, 64, 0, 3),
    (4096, 512, 5, 1),
    (4096, 4096, 100, 3),
    (4096, 4096, 1000, 1),
)
_COUNTS = ("status", "attempts", "first_pass_valid", "present", "episode", "rejections")
_MADE = ("qpos", "mocap_pos", "mocap_quat", "grasp", "grasp_qpos", "pregrasp_qpos", *_COUNTS)


def sizes(device: str, **others: int) -> dict[str, SearchSize]:
    """Sizes by name: few and many trials and restarts at once, less room than there are worlds, and more."""
    found = {}
    for busy, candidates, rows, lanes in _SIZES:
        words = {"busy": busy, "candidates": candidates, "grasps": candidates, "rows": rows}
        words |= dict.fromkeys(("lanes", "parts", "blocks"), lanes)
        found[f"{busy}-{candidates}-{rows}-{lanes}"] = replace(default_size(device), **{**words, **others})
    return found


def made(
    compiled: CompiledScene, size: SearchSize | None, nworld: int, *, graph: bool = False, split: str = "train"
) -> list[bytes]:
    """Return the bits of three episodes, of which the second is that of every third world, and of all counts."""
    generator = LayoutGenerator(compiled, nworld, seed=21, size=size, split=split)
    mask = wp.array(np.ones(nworld, bool), dtype=bool, device=compiled.device)
    run = LaunchSequence(lambda: generator.launch_generate(mask), wp.get_device(compiled.device), graph=graph)
    found = []
    for every in (1, 3, 1):
        mask.assign(np.arange(nworld) % every == 0)
        run.replay()
        found.append(b"".join(getattr(generator.layouts, name).cpu().numpy().tobytes() for name in _MADE))
    return found

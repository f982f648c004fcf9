"""Compile the kernels of a generator in parallel, before the first launch would compile them one by one."""

import os
from pathlib import Path

import warp as wp

from sceniris_gym.device.kernel_log import tell_of_compiling
from sceniris_gym.layout import seeds
from sceniris_gym.layout.reaching import free_grasps, hits, ik, poses, start, waves
from sceniris_gym.layout.wave import (
    accept,
    ahead,
    collision,
    draw,
    points,
    prefilter,
    region_pieces,
    rounds,
    settle,
    sides,
    standing,
    start_kinds,
)
from sceniris_gym.layout.wave.search import Workspace


def kernel_modules(work: Workspace, *, staged: bool) -> list[wp.Module]:
    """Return the Warp modules of a generator's kernels.

    Args:
        work: Arrays and capacities of the generator.
        staged: Whether the reach stage follows placing.
    """
    frees_grasps = work.search.free.shape[1] > 0
    files = [draw, prefilter, accept, rounds, settle, seeds]
    files += [sides, region_pieces, points] if work.compiled.related else []
    files += [ahead] if work.ahead > 0 else []
    files += [standing] if work.statics is not None else []
    files += [waves, poses, ik, hits] if staged else []
    files += [start_kinds, start] if work.compiled.starts is not None else []
    files += [free_grasps] if frees_grasps else []
    own = collision.launched_kernels(work)  # each with a separate module
    own += free_grasps.OWN_KERNELS if frees_grasps else []
    return [wp.get_module(file.__name__) for file in files] + [kernel.module for kernel in own]


def load_kernels(work: Workspace, *, staged: bool) -> None:
    """Compile and load a generator's kernels on a GPU. Announce the compilation of kernels that Warp's cache lacks.

    On a CPU, Warp compiles one module at a time, so each kernel is loaded later, by its first launch.

    Args:
        work: Arrays and capacities of the generator.
        staged: Whether the reach stage follows placing.
    """
    modules, block_dim = kernel_modules(work, staged=staged), work.size.block_dim
    cache = Path(wp.config.kernel_cache_dir or "")  # has a folder for each module, whichever device it was compiled for
    missing = sum(not (cache / module.get_module_identifier(block_dim)).is_dir() for module in modules)
    if missing:
        tell_of_compiling(work.compiled.device, missing)
    if wp.get_device(work.compiled.device).is_cuda:
        wp.force_load(work.compiled.device, modules=modules, block_dim=block_dim, max_workers=os.cpu_count() or 1)

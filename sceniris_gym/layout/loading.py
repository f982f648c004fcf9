"""Kernels of a generator, compiled in parallel before the first launch: one after the other they take a while."""

from __future__ import annotations

import os
from pathlib import Path

import warp as wp

from sceniris_gym.device.kernel_log import tell_of_compiling
from sceniris_gym.layout.reaching import free_grasps, hits, ik, poses, start, waves
from sceniris_gym.layout.wave import (
    accept,
    ahead,
    collision,
    containment,
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


def kernel_modules(work: Workspace, *, staged: bool) -> tuple[list[wp.Module], list[wp.Module]]:
    """Return Warp's modules of the kernels that a generator launches by lanes, and of those that it launches by blocks.

    Args:
        work: Its arrays and capacities.
        staged: Whether there is a stage after placing.
    """
    frees_grasps = work.search.free.shape[1] > 0
    by_lane = [draw, prefilter, rounds, *([sides, region_pieces] if work.related else [])]
    by_lane += [ahead] if work.ahead > 0 else []
    by_lane += [standing] if work.statics is not None else []
    by_lane += [waves, poses, ik] if staged else []
    by_lane += [start_kinds, start] if work.starts is not None else []
    by_lane += [free_grasps] if frees_grasps else []
    by_block = [accept, settle, *([points] if work.related else []), *([hits] if staged else [])]
    lane_kernels, block_kernels = collision.collision_kernels(work)
    lane_kernels += containment.LANE_KERNELS if work.program.visual else []
    block_kernels += free_grasps.BLOCK_KERNELS if frees_grasps else []
    lanes = [wp.get_module(m.__name__) for m in by_lane] + [k.module for k in lane_kernels]
    return lanes, [wp.get_module(m.__name__) for m in by_block] + [k.module for k in block_kernels]


def _is_kept(module: wp.Module, block_dim: int | None) -> bool:
    """Tell whether Warp's cache has a module, for any device."""
    return Path(wp.config.kernel_cache_dir or "", module.get_module_identifier(block_dim)).is_dir()


def load_kernels(work: Workspace, *, staged: bool) -> None:
    """Compile and load the kernels of a generator on a GPU, unless they are loaded; announce it if it takes a while.

    On a CPU, where Warp compiles one module at a time, the launches load their kernels.

    Args:
        work: As in `kernel_modules`, as the next one.
        staged: Whether there is a stage after placing.
    """
    lanes, blocks = kernel_modules(work, staged=staged)
    device, block_dim = work.device, work.size.block_dim
    on_gpu = wp.get_device(device).is_cuda
    missing = sum(not _is_kept(module, None if on_gpu else 1) for module in lanes)
    missing += sum(not _is_kept(module, block_dim) for module in blocks)
    if missing:
        tell_of_compiling(device, missing)
    if not on_gpu:
        return
    workers = os.cpu_count() or 1
    wp.force_load(device, modules=lanes, max_workers=workers)
    wp.force_load(device, modules=blocks, block_dim=block_dim, max_workers=workers)

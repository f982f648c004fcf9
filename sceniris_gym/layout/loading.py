"""Kernels are compiled side by side ahead of the first launch: on a GPU one after the other takes a while."""

from __future__ import annotations

import os

import warp as wp

from sceniris_gym.layout import (
    accept,
    collision,
    containment,
    draw,
    points,
    reach_hits,
    reach_ik,
    reach_poses,
    reach_waves,
    region_pieces,
    rounds,
    screen,
    sides,
)


def load_kernels(device: str, *, block_dim: int, related: bool, faces: bool, staged: bool) -> None:
    """Compile and load what a generator launches on a GPU, as far as it is not loaded yet.

    Args:
        device: The device; nothing is done for a CPU, where a machine has fewer cores to spare.
        block_dim: Lanes of the blocks that share a candidate.
        related: Whether there are regions that differ between worlds.
        faces: Whether triangles are tested.
        staged: Whether there are stages after placing.
    """
    if not wp.get_device(device).is_cuda:
        return
    by_lane = [draw, screen, rounds, accept, *([sides, region_pieces] if related else [])]
    by_lane += [reach_waves, reach_poses, reach_ik] if staged else []
    by_block = [*([points] if related else []), *([reach_hits] if staged else [])]
    lanes = [wp.get_module(m.__name__) for m in by_lane] + [k.module for k in collision.lane_kernels(faces)]
    lanes += [k.module for k in containment.KERNELS] if faces else []
    blocks = [wp.get_module(m.__name__) for m in by_block] + [collision.block_kernel(faces).module]
    workers = os.cpu_count() or 1
    wp.force_load(device, modules=lanes, max_workers=workers)
    wp.force_load(device, modules=blocks, block_dim=block_dim, max_workers=workers)

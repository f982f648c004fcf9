"""Lanes of a block: each knows if any has something to say, and sees what all wrote before a barrier."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.blocks import block_any, block_sync

LANES, BLOCKS = 96, 40


@wp.kernel(enable_backward=False, module="unique")
def _ask(asked: wp.array2d[int], any_out: wp.array2d[bool], seen_out: wp.array2d[int], shared: wp.array2d[int]):
    """Each lane in turn is asked, and then reads what its neighbour wrote."""
    block, lane = wp.tid()
    any_out[block, lane] = block_any(asked[block, lane]) != 0
    shared[block, lane] = 1000 * block + lane
    block_sync()
    seen_out[block, lane] = shared[block, (lane + 1) % wp.block_dim()]


@pytest.mark.parametrize(
    ("device", "lanes"), [("cpu", 1), pytest.param("cuda:0", LANES, marks=pytest.mark.cuda)], ids=["cpu", "cuda"]
)
def test_lanes_of_a_block_know_of_each_other_and_of_no_other_block(device: str, lanes: int):
    """One lane in some blocks, none in others; blocks of three warps, which run apart from each other."""
    rng = np.random.default_rng(0)
    asked = np.zeros((BLOCKS, lanes), np.int32)
    asked[np.arange(0, BLOCKS, 2), rng.integers(lanes, size=BLOCKS // 2)] = rng.integers(1, 9, BLOCKS // 2)
    found = wp.zeros((BLOCKS, lanes), dtype=bool, device=device)
    seen, shared = (wp.zeros((BLOCKS, lanes), dtype=int, device=device) for _ in range(2))
    inputs = [wp.array(asked, dtype=int, device=device), found, seen, shared]
    wp.launch_tiled(_ask, dim=[BLOCKS], inputs=inputs, block_dim=lanes, device=device)
    assert (found.numpy() == (asked != 0).any(axis=1)[:, None]).all()
    expected = 1000 * np.arange(BLOCKS)[:, None] + (np.arange(lanes) + 1) % lanes
    assert (seen.numpy() == expected).all()

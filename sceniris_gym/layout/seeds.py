"""Seeds and episodes of worlds: checked once on the host, then chosen, opened and closed on the device.

The seed and episode of a layout are its key. Before the layout is made, its key is opened: written to `pending_seed`
and `pending_episode`. When the layout is served, its key is closed: copied to `seed` and `episode`.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.layouts import LayoutsView, close_episode, open_episode
from sceniris_gym.layout.masks import selects

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _reseed(
    seeds: wp.array[wp.uint64],
    episodes: wp.array[int],
    mask: wp.array[bool],
    # Layouts in: episode; out: next_episode; both: seed, next_seed
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    layouts.next_seed[worldid] = layouts.seed[worldid]
    if seeds:
        layouts.next_seed[worldid] = seeds[worldid]
    layouts.next_episode[worldid] = 0
    if episodes:
        layouts.next_episode[worldid] = episodes[worldid]
    if layouts.episode[worldid] < 0:  # the world has no layout yet, so its seed can change at once
        layouts.seed[worldid] = layouts.next_seed[worldid]


def launch_reseed(
    layouts: LayoutsView, seeds: wp.array | None, mask: wp.array | None, episodes: wp.array | None
) -> None:
    """Choose the next layouts of the masked worlds. Their present layouts keep their seeds and episodes.

    If a world has no layout yet, its seed changes at once.

    Args:
        layouts: The layouts, on the device like all other arrays.
        seeds: Seeds, shape (nworld,), uint64. If None, the seeds of the present layouts are kept.
        mask: Selected worlds, shape (nworld,), bool. None selects all.
        episodes: Episodes, shape (nworld,), int32. None is episode 0.
    """
    nworld, device = layouts.seed.shape[0], layouts.seed.device
    wp.launch(_reseed, dim=nworld, inputs=[seeds, episodes, mask], outputs=[layouts], device=device)


@wp.kernel
def _open(
    mask: wp.array[bool],
    # Layouts in: seed, episode, next*, stream; out: draws*, pending*
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    open_episode(layouts, worldid)


def launch_open(layouts: LayoutsView, mask: wp.array | None) -> None:
    """Write the seeds and episodes of the masked worlds' next layouts to `pending_seed` and `pending_episode`.

    The seeds and episodes of present layouts do not change.
    """
    wp.launch(_open, layouts.seed.shape[0], inputs=[mask], outputs=[layouts], device=layouts.seed.device)


@wp.func
def count_rejections(made: LayoutsView, worldid: int, obj: int, rejections: wp.array2d[wp.int64]):
    """Add the rejections of an object in a served layout to the running counts."""
    for cause in range(made.row_rejections.shape[2]):
        number = made.row_rejections[worldid, obj, cause]
        if number > 0:
            wp.atomic_add(rejections, obj, cause, wp.int64(number))


@wp.kernel
def _close(
    mask: wp.array[bool],
    # Layouts in: pending*, next_param, row_rejections; out: key*, next_episode; both: draws*, rejections
    layouts: LayoutsView,
):
    worldid, obj = wp.tid()
    if not selects(mask, worldid):
        return
    if obj == 0:
        close_episode(layouts, layouts, worldid)
    count_rejections(layouts, worldid, obj, layouts.rejections)


def launch_close(layouts: LayoutsView, mask: wp.array | None, block_dim: int = 256) -> None:
    """Serve the masked worlds the layouts that were made for them, and add up the rejections of these layouts."""
    dim = layouts.seed.shape[0], layouts.rejections.shape[0]
    wp.launch(_close, dim, inputs=[mask], outputs=[layouts], device=layouts.seed.device, block_dim=block_dim)


def as_seeds(seed: int | Sequence[int] | np.ndarray, nworld: int) -> np.ndarray:
    """Return a seed for each world, shape (nworld,), uint64. An integer gives world i the seed + i modulo 2^64.

    Raises:
        ArgumentError: A seed that is no integer from 0 to 2^64 - 1, or a wrong number of seeds.
    """
    if isinstance(seed, int | np.integer | np.bool_):
        if not _is_seed(seed):
            raise ArgumentError(f"seed={short(seed)} should be an integer from 0 to 2^64 - 1.")
        return np.uint64(seed) + np.arange(nworld, dtype=np.uint64)
    many = isinstance(seed, Sequence) and not isinstance(seed, str | bytes)
    many = many or (isinstance(seed, np.ndarray) and seed.ndim == 1 and not isinstance(seed, np.ma.MaskedArray))
    if not many or len(seed) != nworld:
        given = f"{len(seed)} in a " if many else ""
        raise ArgumentError(
            f"seed should be one integer, or a sequence of {nworld}, one per world, got {given}{type(seed).__name__}."
        )
    if isinstance(seed, np.ndarray) and (seed.dtype.kind == "u" or (seed.dtype.kind == "i" and (seed >= 0).all())):
        return seed.astype(np.uint64)
    for i, value in enumerate(seed.tolist() if isinstance(seed, np.ndarray) else seed):
        if not _is_seed(value):
            raise ArgumentError(f"seed[{i}]={short(value)} should be an integer from 0 to 2^64 - 1.")
    return np.fromiter(seed, np.uint64, len(seed))


def _is_seed(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.bool_) and 0 <= int(value) < 1 << 64

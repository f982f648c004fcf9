"""Seeds of worlds as users pass them: checked once, then on the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.messages import short
from sceniris_gym.errors import SeedError

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _reseed(
    seed_in: wp.array[wp.uint64],
    mask: wp.array[bool],
    # Layouts out:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    seed[worldid] = seed_in[worldid]
    episode[worldid] = -1


def launch_reseed(seeds: wp.array, mask: wp.array | None, seed: wp.array, episode: wp.array) -> None:
    """Give the masked worlds new seeds, so that the next layout that they get is that of episode 0.

    Args:
        seeds: New seeds, shape (nworld,), uint64, on the device like all other arrays.
        mask: Which worlds, shape (nworld,), bool; all if None.
        seed: Seeds of the worlds' layouts to write to, shape (nworld,), uint64.
        episode: Their episodes to write to, shape (nworld,), int32.
    """
    wp.launch(_reseed, dim=seed.shape[0], inputs=[seeds, mask], outputs=[seed, episode], device=seed.device)


def seeds_on_device(seed: Any, nworld: int, device: Any) -> wp.array:
    """Return a seed for each world on a device, shape (nworld,), uint64: a Warp array as it is, others by `as_seeds`.

    Raises:
        SeedError: See `as_seeds`; or a Warp array of another type, shape or device.
    """
    if not isinstance(seed, wp.array):
        return wp.array(as_seeds(seed, nworld), dtype=wp.uint64, device=device)
    if seed.dtype is not wp.uint64 or seed.shape != (nworld,) or seed.device != wp.get_device(device):
        raise SeedError(
            f"seeds on the device should be a uint64 array of shape ({nworld},) on {device}, got "
            f"{seed.dtype.__name__} of shape {tuple(seed.shape)} on {seed.device}."
        )
    return seed


def as_seeds(seed: int | Sequence[int] | np.ndarray, nworld: int) -> np.ndarray:
    """Return a seed for each world, shape (nworld,), uint64: seed + i (modulo 2^64) for an integer, else as given.

    Raises:
        SeedError: A seed that is no integer from 0 to 2^64 - 1, or a wrong number of them.
    """
    if isinstance(seed, bool | np.bool_):
        raise SeedError(f"seed={seed} should be an integer from 0 to 2^64 - 1, not a boolean.")
    if isinstance(seed, int | np.integer):
        if not 0 <= int(seed) < 1 << 64:
            raise SeedError(f"seed={short(seed)} should be an integer from 0 to 2^64 - 1.")
        with np.errstate(over="ignore"):
            return np.uint64(seed) + np.arange(nworld, dtype=np.uint64)
    many = isinstance(seed, Sequence) and not isinstance(seed, str | bytes)
    many = many or (isinstance(seed, np.ndarray) and seed.ndim == 1)
    if not many or len(seed) != nworld:
        given = f"{len(seed)} of them, " if many else ""
        raise SeedError(
            f"seeds should be one integer, or a sequence of {nworld}, one per world; got {given}{type(seed).__name__}."
        )
    if isinstance(seed, np.ndarray) and (seed.dtype.kind == "u" or (seed.dtype.kind == "i" and (seed >= 0).all())):
        return seed.astype(np.uint64)
    for i, value in enumerate(seed.tolist() if isinstance(seed, np.ndarray) else seed):
        if not _is_seed(value):
            raise SeedError(f"seeds[{i}]={short(value)} should be an integer from 0 to 2^64 - 1.")
    return np.fromiter(seed, np.uint64, len(seed))


def _is_seed(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.bool_) and 0 <= int(value) < 1 << 64

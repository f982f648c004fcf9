"""`Bank`: the fallback bank of valid layouts, as device code reads it."""

import warp as wp

from sceniris_gym.program.device import allocate


@wp.struct
class Bank:
    """The bank of a scene: layouts of the split "train", then layouts of "eval". Only `compile_scene` writes them."""

    ntrain: int
    seed: wp.array[wp.uint64]  # with `episode`, the key of each layout in the split of the bank
    episode: wp.array[int]
    start: wp.array[int]
    present: wp.array2d[int]
    qpos: wp.array2d[float]
    mocap_pos: wp.array2d[wp.vec3]
    mocap_quat: wp.array2d[wp.quat]
    grasp: wp.array2d[int]
    grasp_qpos: wp.array3d[float]
    pregrasp_qpos: wp.array3d[float]
    path: wp.array3d[float]


def empty_bank(device: str) -> Bank:
    """Return a bank without layouts, so no world can take a fallback from it."""
    # pyrefly: ignore[missing-attribute]
    shapes = {name: (0,) * Bank.vars[name].type.ndim for name in Bank.vars if name != "ntrain"}
    return allocate(Bank, Bank(), shapes, device)  # pyrefly: ignore[missing-argument]

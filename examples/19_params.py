"""Params: widen the regions of objects while an environment runs, and reproduce a layout by its id."""

from typing import Any

import gymnasium as gym
import torch
import tyro

import sceniris_gym  # noqa: F401, registers the environments

THINGS = ("bottle", "apple", "orange", "can", "block")
PARAMS = [f"objects.{name}.region" for name in THINGS]


def main(num_envs: int = 1024, resets: int = 4, device: str | None = None) -> None:
    """Reset worlds with wider and wider regions.

    Args:
        num_envs: number of worlds.
        resets: number of resets. The last reset has the regions of the scene file.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    envs = gym.make_vec("sceniris_gym/TabletopReach-v0", num_envs=num_envs, device=device, params=PARAMS)
    base: Any = envs.unwrapped
    _, info = envs.reset(seed=0)
    widest = {name: values[0] for name, values in info["layout"]["params"].items()}
    told, wanted = "", torch.empty(0)
    for k in range(1, resets + 1):
        share = 0.5 + 0.5 * k / resets
        for name, box in widest.items():
            middle = 0.5 * (box[:2] + box[2:]).repeat(2)
            base.set_param(name, torch.lerp(middle, box, share))
        envs.reset()
        at = torch.stack([base.state.pose(name)[:, :2] for name in THINGS])
        size = at.amax(dim=(0, 1)) - at.amin(dim=(0, 1))
        print(f"{share:.0%} of the regions: objects lie within {size[0]:.2f} by {size[1]:.2f} m")
        if k == 1:
            told, wanted = base.layout_ids()[0], base.state.pose("apple")[0].clone()
    envs.reset(options={"layouts": told})
    print(f"the first narrow layout again: {torch.equal(base.state.pose('apple')[0], wanted)}")
    print(f"its id has {told.count('=')} params")


if __name__ == "__main__":
    tyro.cli(main)

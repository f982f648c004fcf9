"""Object variants: each reset draws an asset for each world. Assets have different masses and fall onto a table."""

import mujoco_warp as mjw
import numpy as np
import tyro
import warp as wp

from sceniris_gym import ResetRandomizer, compile_scene, make_worlds

THINGS = ("can", "mug", "bowl", "banana", "book", "brick")
SCENE = {
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "thing": {
            "asset": list(THINGS),
            "orientation": "any",
            "region": {"box": [[-0.2, -0.2, 0.6], [0.2, 0.2, 0.8]]},
        },
    },
}


def main(nworld: int = 32, resets: int = 3, seconds: float = 1.0, device: str | None = None) -> None:
    """Let the objects of all worlds fall, and print their masses and how many stay on the table.

    Args:
        nworld: number of worlds.
        resets: number of resets. Every reset draws the assets again.
        seconds: time for objects to fall and come to rest [s].
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    compiled = compile_scene(SCENE, device)
    mjm = compiled.sim_mjm  # one body for all variants
    model, data = make_worlds(compiled, nworld)  # fields in which variants differ have a row per world
    with wp.ScopedDevice(compiled.device):
        randomizer = ResetRandomizer(compiled, model, data, seed=0)
        body = mjm.body("thing").id
        for _ in range(resets):
            randomizer.reset()
            for _ in range(round(seconds / mjm.opt.timestep)):
                mjw.step(model, data)
            drawn = randomizer.variants.cpu().numpy()[:, 0]
            height, mass = data.xpos.numpy()[:, body, 2], model.body_mass.numpy()[:, body]
            for i, name in enumerate(THINGS):
                if rows := np.flatnonzero(drawn == i).tolist():
                    on = (height[rows] > 0.35).mean()
                    print(f"{name}: {len(rows)} worlds, {mass[rows[0]]:.3f} kg, {on:.0%} still on the table")


if __name__ == "__main__":
    tyro.cli(main)

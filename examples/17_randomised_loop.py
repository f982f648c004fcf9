"""Model fields in your mujoco_warp loop: pushed blocks slide as far as the friction of their world allows."""

import mujoco
import mujoco_warp as mjw
import torch
import tyro
import warp as wp

from sceniris_gym import ResetRandomizer, compile_scene, make_worlds

MJCF = """
<mujoco>
  <worldbody>
    <light pos="0 -1 3"/>
    <geom name="ground" type="plane" size="2 2 .1" friction=".05"/>
    <body name="block" pos="0 0 .03"><freejoint/><geom type="box" size=".04 .04 .03" mass=".2"/></body>
  </worldbody>
</mujoco>
"""
OBJECTS = {"block": {"on": "ground", "region": {"box": [[-0.5, -0.5], [-0.3, 0.5]]}, "orientation": {"yaw": [0, 0]}}}


def main(nworld: int = 64, steps: int = 500, device: str | None = None) -> None:
    """Push the blocks, and print how far they slide.

    Args:
        nworld: number of worlds.
        steps: physics steps, of 2 ms each.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    compiled = compile_scene({"model": mujoco.MjSpec.from_string(MJCF), "objects": OBJECTS}, device)
    model, data = make_worlds(compiled, nworld, fields=("body_mass", "geom_friction"))  # a row for each world
    with wp.ScopedDevice(compiled.device):
        randomizer = ResetRandomizer(compiled, model, data, seed=0)
        randomizer.reset()
        u, v = (randomizer.random(name) for name in ("mass", "friction"))  # from seed and episode
        randomizer.scale_field("body_mass", "block", 0.5 + 2.0 * u)
        randomizer.scale_field("geom_friction", "block", 0.1 + 0.6 * v)
        randomizer.refresh()  # recomputes inverse weights
        mass, friction = (randomizer.model_field(name, "block") for name in ("body_mass", "geom_friction"))
        start = randomizer.layouts.qpos[:, 0].clone()
        wp.to_torch(data.qvel)[:, 0] = 1.0  # m/s
        for _ in range(steps):
            mjw.step(model, data)
        way = wp.to_torch(data.qpos)[:, 0] - start
    slow = friction[:, 0, 0] > 0.4
    print(f"masses from {mass.min():.2f} to {mass.max():.2f} kg")
    print(f"blocks of low friction slide {way[~slow].mean():.2f} m, the others {way[slow].mean():.2f} m")
    print(f"correlation of friction and way: {torch.corrcoef(torch.stack([friction[:, 0, 0], way]))[0, 1]:.2f}")


if __name__ == "__main__":
    tyro.cli(main)

"""Your model in your mujoco_warp loop: a paddle pushes boxes off a bench, and a world with a fallen crate is reset."""

from pathlib import Path

import mujoco_warp as mjw
import tyro
import warp as wp

from sceniris_gym import ResetRandomizer, compile_scene, make_worlds

SCENE = {
    "model": str(Path(__file__).with_name("bench.xml")),  # keeps its options, names and start pose
    "objects": {  # without an asset, an object is a body of the model
        "bench": {"kind": "static", "joints": {"travel": {"range": [0.0, 0.1]}}},
        "crate": {"on": "bench", "region": {"fraction": [[0.3, 0.0], [0.9, 1.0]]}, "ratio_on_support": 1},
        "parcel": {"on": "bench", "relations": [{"near": "crate", "distance": {"max": 0.25}}], "ratio_on_support": 1},
    },
}


def main(nworld: int = 64, steps: int = 1500, device: str | None = None) -> None:
    """Push until the crate falls, reset, and repeat.

    Args:
        nworld: number of worlds.
        steps: physics steps, of 2 ms each.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    compiled = compile_scene(SCENE, device)
    model, data = make_worlds(compiled, nworld, nconmax=64, njmax=256)  # room for contacts in each world
    with wp.ScopedDevice(compiled.device):
        randomizer = ResetRandomizer(compiled, model, data, seed=0)
        randomizer.reset()  # all worlds, and the paddle's actuator holds the sampled position
        with wp.ScopedCapture() as capture:
            mjw.step(model, data)

        # Views of the simulation's arrays. Any library can compute the mask from them, without copies to the host.
        height = wp.to_torch(data.xpos)[:, compiled.mjm.body("crate").id, 2]
        control = wp.to_torch(data.ctrl)
        resets = 0
        for _ in range(steps):
            control.add_(0.001).clamp_(max=0.76)
            wp.capture_launch(capture.graph)
            fallen = height < 0.3
            randomizer.reset(fallen)
            resets += fallen.sum()

    episode = randomizer.layouts.episode.cpu().numpy()
    print(f"{int(resets)} crates fell in {steps} steps of {nworld} worlds; episodes are now {episode[:8]}")
    for name, causes in randomizer.rejection_counts().items():
        print(f"candidates of {name} that were rejected:", {cause: n for cause, n in causes.items() if n} or "none")


if __name__ == "__main__":
    tyro.cli(main)

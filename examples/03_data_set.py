"""A data set of layouts, written to files and read with only MuJoCo and NumPy.

`sceniris-gym generate kitchen -n 64 -o layouts/kitchen` writes the same files from the command line.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import tyro

from sceniris_gym import cli


def main(
    scene: str = "kitchen", n: int = 64, folder: Path = Path("layouts/kitchen"), device: str | None = None
) -> None:
    """Write layouts of a scene, and read them.

    Args:
        scene: name of a shipped scene, or the path of a scene file.
        n: number of layouts. Row i has seed i and episode 0.
        folder: folder for `dataset.json`, `scene.zip` and `layouts-*.npy`. It should not hold a data set.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    where = [] if device is None else ["--device", device]
    cli.main(["generate", scene, "-n", str(n), "-o", str(folder), *where])
    look(folder)


def look(folder: Path) -> None:
    """Load the layouts into stock MuJoCo, measure contacts, and let the first layout settle for half a second."""
    layouts = np.concatenate([np.load(part) for part in sorted(folder.glob("layouts-*.npy"))])
    model = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    data = mujoco.MjData(model)
    deepest = 0.0
    for qpos, pos, quat in zip(layouts["qpos"], layouts["mocap_pos"], layouts["mocap_quat"], strict=True):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, pos, quat
        mujoco.mj_forward(model, data)
        deepest = max(deepest, -data.contact.dist.min(initial=0.0))
    print(f"{len(layouts)} layouts, {layouts['valid'].mean():.1%} of them fresh and valid")
    print(f"deepest contact in MuJoCo before the first step: {1000.0 * deepest:.3f} mm")

    data.qpos[:], data.mocap_pos[:] = layouts["qpos"][0], layouts["mocap_pos"][0]
    data.mocap_quat[:] = layouts["mocap_quat"][0]
    mujoco.mj_forward(model, data)
    names = json.loads((folder / "dataset.json").read_text())["object_names"]
    start = {name: data.body(name).xpos.copy() for name in names}
    while data.time < 0.5:
        mujoco.mj_step(model, data)
    for name in names:
        x, y, z = start[name]
        moved = 1000.0 * np.linalg.norm(data.body(name).xpos - start[name])
        print(f"  {name:<12} x {x:+.3f}  y {y:+.3f}  z {z:+.3f} m, moved {moved:.1f} mm while it settled")


if __name__ == "__main__":
    tyro.cli(main)

"""A data set as npz and JSON, read back in stock MuJoCo: poses of objects by name, and the full state.

`sceniris-gym generate mid -n 64 -o layouts/formats --format npz,json` writes the same files from the command line.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import tyro

from sceniris_gym import cli


def main(scene: str = "mid", n: int = 64, folder: Path = Path("layouts/formats"), device: str | None = None) -> None:
    """Write layouts of a scene in both formats, and read them with NumPy and json.

    Args:
        scene: name of a shipped scene, or the path of a scene file.
        n: number of layouts.
        folder: folder for the files. It should not hold a data set.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    where = [] if device is None else ["--device", device]
    cli.main(["generate", scene, "-n", str(n), "-o", str(folder), "--format", "npz,json", *where])
    model = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    bodies = {model.body(i).name for i in range(model.nbody)}  # `poses` also has the robot
    read_json(folder, model, bodies)
    read_npz(folder, model, bodies)


def read_json(folder: Path, model: mujoco.MjModel, bodies: set[str]) -> None:
    """Load every layout into stock MuJoCo by its `qpos`, and compare the poses of bodies with `poses`."""
    data, off, joints = mujoco.MjData(model), 0.0, 0
    layouts = json.loads((folder / "layouts-00000.json").read_text())
    for layout in layouts:
        data.qpos[:] = layout["qpos"]
        data.mocap_pos.flat, data.mocap_quat.flat = np.ravel(layout["mocap_pos"]), np.ravel(layout["mocap_quat"])
        mujoco.mj_kinematics(model, data)
        for name in bodies & layout["poses"].keys():
            off = max(off, float(np.abs(data.body(name).xpos - layout["poses"][name][:3]).max()))
        joints += sum(np.allclose(data.joint(name).qpos, position) for name, position in layout["joints"].items())
    print(f"json: {len(layouts)} layouts, poses within {1e6 * off:.1f} um, {joints} joint positions")


def read_npz(folder: Path, model: mujoco.MjModel, bodies: set[str]) -> None:
    """Set free objects to their poses in the last layout by name, without addresses in `qpos`."""
    data, layouts = mujoco.MjData(model), np.load(folder / "layouts-00000.npz")
    names = [key.removeprefix("pose/") for key in layouts if key.removeprefix("pose/") in bodies]
    for name in names:
        if model.body(name).dofnum == 6:
            data.joint(int(model.body(name).jntadr[0])).qpos[:] = layouts[f"pose/{name}"][-1]
    same = np.allclose(data.qpos[model.nq - 7 :], layouts["qpos"][-1, -7:], atol=1e-6)
    print(f"npz: poses of {', '.join(names)}; set by name, qpos is as written: {same}")


if __name__ == "__main__":
    tyro.cli(main)

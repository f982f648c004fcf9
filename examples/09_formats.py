"""A data set as npz and JSON, read back in stock MuJoCo: poses of things by name, and the whole state.

`sceniris-gym generate mid -n 64 -o layouts/formats --format npz,json` writes the same files from the command line.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np
import tyro

from sceniris_gym import cli


def main(scene: str = "mid", n: int = 64, folder: Path = Path("layouts/formats"), device: str | None = None) -> None:
    """Write layouts of a scene in both formats, and read them with the libraries that own these formats.

    Args:
        scene: name of a shipped scene, or the path of a scene file.
        n: number of layouts.
        folder: folder for the files, without a data set in it.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    where = [] if device is None else ["--device", device]
    cli.main(["generate", scene, "-n", str(n), "-o", str(folder), "--format", "npz,json", *where])
    read_json(folder)
    read_npz(folder)


def read_json(folder: Path) -> None:
    """Put every layout into stock MuJoCo by its `qpos`, and compare the poses of bodies with `poses`."""
    model = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    data, off, joints = mujoco.MjData(model), 0.0, 0
    layouts = json.loads((folder / "layouts-00000.json").read_text())
    for layout in layouts:
        data.qpos[:] = layout["qpos"]
        data.mocap_pos.flat, data.mocap_quat.flat = np.ravel(layout["mocap_pos"]), np.ravel(layout["mocap_quat"])
        mujoco.mj_kinematics(model, data)
        for name in bodies(model, layout["poses"]):
            off = max(off, float(np.abs(data.body(name).xpos - layout["poses"][name][:3]).max()))
        joints += sum(np.allclose(data.joint(name).qpos, position) for name, position in layout["joints"].items())
    print(f"json: {len(layouts)} layouts, poses within {1e6 * off:.1f} um, {joints} joint positions")


def bodies(model: mujoco.MjModel, names: Iterable[str]) -> list[str]:
    """Return the names that bodies of the model have; a robot, or an object with a `body`, has another name there."""
    return [name for name in names if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0]


def read_npz(folder: Path) -> None:
    """Put free objects at their poses by name, whatever their addresses in `qpos` are."""
    model = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    data, layouts = mujoco.MjData(model), np.load(folder / "layouts-00000.npz")
    named = bodies(model, [key.removeprefix("pose/") for key in layouts if key.startswith("pose/")])
    free = [name for name in named if model.body(name).dofnum == 6]
    for i in range(len(layouts["qpos"])):
        for name in free:
            data.joint(int(model.body(name).jntadr[0])).qpos[:] = layouts[f"pose/{name}"][i]
    same = np.allclose(data.qpos[model.nq - 7 :], layouts["qpos"][-1, -7:], atol=1e-6)
    print(f"npz: poses of {', '.join(named)}; set by name, qpos is as written: {same}")


if __name__ == "__main__":
    tyro.cli(main)

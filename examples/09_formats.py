"""A data set in all formats, read back: npz and JSON in stock MuJoCo, USD in usd-core.

`sceniris-gym generate mid -n 64 -o layouts/formats --format npz,usd,json` writes the same files from the command line.
USD needs the extra: pip install 'sceniris-gym[import]'.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np
import tyro
from pxr import Usd, UsdGeom

from sceniris_gym import cli


def main(
    scene: str = "mid", n: int = 64, folder: Path = Path("layouts/formats"), row: int = 0, device: str | None = None
) -> None:
    """Write layouts of a scene in all formats, and read them with the libraries that own these formats.

    Args:
        scene: name of a shipped scene, or the path of a scene file.
        n: number of layouts.
        folder: folder for the files, without a data set in it.
        row: layout that becomes a stage of its own.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    where = [] if device is None else ["--device", device]
    cli.main(["generate", scene, "-n", str(n), "-o", str(folder), "--format", "npz,usd,json", *where])
    read_json(folder)
    read_npz(folder)
    read_usd(folder)
    print(f"row {row} as a stage of its own: {frozen(folder / 'layouts-00000.usdc', row)}")


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
            pose = layout["poses"][name]
            off = max(off, float(np.abs(data.body(name).xpos - pose[:3]).max()))
        for name, position in layout["joints"].items():
            joints += np.allclose(data.joint(name).qpos, position)
    print(f"json: {len(layouts)} layouts, poses within {1e6 * off:.1f} um, {joints} joint positions")


def bodies(model: mujoco.MjModel, names: Iterable[str]) -> list[str]:
    """Return the names that bodies of the model have; a robot, or an object with a `body`, has another name there."""
    return [name for name in names if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0]


def read_npz(folder: Path) -> None:
    """Do the same by columns: put free objects at their poses by name, whatever their addresses in `qpos` are."""
    model = mujoco.MjSpec.from_zip(str(folder / "scene.zip")).compile()
    data, layouts = mujoco.MjData(model), np.load(folder / "layouts-00000.npz")
    named = bodies(model, [key.removeprefix("pose/") for key in layouts if key.startswith("pose/")])
    free = [name for name in named if model.body(name).dofnum == 6]
    for i in range(len(layouts["qpos"])):
        for name in free:
            data.joint(int(model.body(name).jntadr[0])).qpos[:] = layouts[f"pose/{name}"][i]
    same = np.allclose(data.qpos[model.nq - 7 :], layouts["qpos"][-1, -7:], atol=1e-6)
    print(f"npz: poses of {', '.join(named)}; set by name, qpos is as written: {same}")


def read_usd(folder: Path) -> None:
    """Compare the poses of objects in frame i of the stage with those in row i of the npz file."""
    stage, layouts = Usd.Stage.Open(str(folder / "layouts-00000.usdc")), np.load(folder / "layouts-00000.npz")
    off, frames = 0.0, range(int(stage.GetEndTimeCode()) + 1)
    for i in frames:
        cache = UsdGeom.XformCache(i)
        for key in (key for key in layouts if key.startswith("pose/")):
            world = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(f"/World/{key.removeprefix('pose/')}"))
            off = max(off, float(np.abs(np.array(world.ExtractTranslation()) - layouts[key][i, :3]).max()))
    seed = stage.GetPrimAtPath("/World").GetAttribute("layout:seed").Get(frames[-1])
    meshes = sum(prim.IsA(UsdGeom.Mesh) for prim in stage.Traverse())
    print(f"usd: {len(frames)} frames, the last of seed {seed}; {meshes} meshes; poses within {1e6 * off:.1f} um")


def frozen(part: Path, row: int) -> Path:
    """Write one row as a stage without time, for simulators and renderers of single scenes."""
    moving = Usd.Stage.Open(str(part))
    path = part.with_name(f"layout-{row}.usda")
    stage = Usd.Stage.CreateNew(str(path))
    stage.GetRootLayer().subLayerPaths.append("./scene.usdc")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for attribute in (a for prim in moving.Traverse() for a in prim.GetAttributes() if a.GetNumTimeSamples()):
        prim = stage.OverridePrim(attribute.GetPrim().GetPath())
        prim.CreateAttribute(attribute.GetName(), attribute.GetTypeName()).Set(attribute.Get(row))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    stage.Save()
    return path


if __name__ == "__main__":
    tyro.cli(main)

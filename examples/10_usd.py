"""A data set as USD: a stage with one frame per layout, and a separate stage of a single layout.

`sceniris-gym generate mid -n 64 -o layouts/usd --format npz,usd` writes the same files from the command line.
Needs the extra: pip install 'sceniris-gym[import]'.
"""

from pathlib import Path

import numpy as np
import tyro
from pxr import Usd, UsdGeom

from sceniris_gym import cli


def main(
    scene: str = "mid", n: int = 64, folder: Path = Path("layouts/usd"), row: int = 0, device: str | None = None
) -> None:
    """Write layouts of a scene, compare the stage with the npz file, and export one layout.

    Args:
        scene: name of a shipped scene, or the path of a scene file.
        n: number of layouts.
        folder: folder for the files. It should not hold a data set.
        row: layout to export as a separate stage.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    where = [] if device is None else ["--device", device]
    cli.main(["generate", scene, "-n", str(n), "-o", str(folder), "--format", "npz,usd", *where])
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
    path = folder / f"layout-{row}.usda"
    frozen(stage, row, path)
    print(f"row {row} as a separate stage: {path}")


def frozen(moving: Usd.Stage, row: int, path: Path) -> None:
    """Write one row as a stage without time, next to `scene.usdc`, for programs that read a single scene."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.GetRootLayer().subLayerPaths.append("./scene.usdc")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for attribute in (a for prim in moving.Traverse() for a in prim.GetAttributes() if a.GetNumTimeSamples()):
        prim = stage.OverridePrim(attribute.GetPrim().GetPath())
        prim.CreateAttribute(attribute.GetName(), attribute.GetTypeName()).Set(attribute.Get(row))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    stage.Save()


if __name__ == "__main__":
    tyro.cli(main)

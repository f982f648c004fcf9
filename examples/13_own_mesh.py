"""Your mesh: imported as an asset, placed on a table in sixteen layouts, and drawn."""

from pathlib import Path

import trimesh
import tyro

from sceniris_gym import LayoutGenerator, cli, compile_scene
from sceniris_gym.pictures import captioned, save


def scene(asset: Path) -> dict:
    """Return a scene with three copies of an asset on a table."""
    thing = {"asset": str(asset), "on": "table", "orientation": "stable", "ratio_on_support": 1}
    return {"objects": {"table": {"asset": "table", "kind": "static"}, "first": thing, "second": thing, "third": thing}}


def main(folder: Path = Path("own_mesh"), device: str | None = None) -> None:
    """Import a mesh, and draw layouts of a scene with three copies.

    Args:
        folder: folder for the mesh, the asset and the picture.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    folder.mkdir(parents=True, exist_ok=True)
    mesh = folder / "wedge.obj"  # use your OBJ, STL, PLY, GLB, DAE, URDF or USD file here
    trimesh.Trimesh(
        vertices=[[0, 0, 0], [12, 0, 0], [12, 8, 0], [0, 8, 0], [0, 0, 6], [0, 8, 6]],
        faces=[[0, 2, 1], [0, 3, 2], [0, 1, 4], [3, 5, 2], [0, 4, 3], [4, 5, 3], [1, 2, 4], [2, 5, 4]],
    ).export(mesh)
    cli.main(["import", str(mesh), "--scale", "cm", "-o", str(folder / "wedge.xml")])

    compiled = compile_scene(scene(folder / "wedge.xml"), device)
    generator = LayoutGenerator(compiled, 16, seed=0)
    generator.generate()
    table = generator.table()
    save(captioned(compiled.mjm, table, [f"seed {seed}" for seed in table.seed]), folder / "layouts.png")
    print(f"{table.valid.sum()} of 16 layouts are valid; {folder / 'layouts.png'} shows them")


if __name__ == "__main__":
    tyro.cli(main)

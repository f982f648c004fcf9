"""The pictures in the list of examples: three worlds of the scene of each example.

python -m docs.make_examples   # less than a minute, including the import of a mesh
"""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from docs.make_worlds import grid, worlds_of
from docs.repository_pages import EXAMPLES, ROOT
from sceniris_gym import compile_scene

FOLDER = Path(__file__).parent / "pictures"
SHIPPED = {
    "01_vector_env": "drawer_pick",
    "03_data_set": "kitchen",
    "05_stable_baselines": "tabletop_reach",
    "06_own_ppo": "tabletop_reach",
    "07_view": "tabletop_reach",
    "08_all_gpus": "tabletop_reach",
    "09_formats": "mid",
    "10_usd": "mid",
    "11_replay_failures": "tabletop_reach",
    "15_pixels": "tabletop_reach",
    "19_params": "tabletop_reach",
    "20_levels": "tabletop_reach",
    "tour": "mid",
}
"""Examples that use a scene of the package, and the scene."""
_COLUMNS = 3


def example(name: str) -> ModuleType:
    """Import an example by its path, because its name starts with a digit."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", ROOT / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def scenes(folder: Path) -> dict[str, str | Mapping]:
    """Return the scene of each example by name. Imported meshes and models are written to a folder."""
    in_memory, own_mesh = example("12_model_in_memory"), example("13_own_mesh")
    own_mesh.main(folder, device="cpu")
    loop, adr = example("17_randomised_loop"), example("21_adr")
    (folder / "ground.xml").write_text(loop.MJCF)
    (folder / "cube.xml").write_text(adr.MJCF)
    (folder / "model.xml").write_text(in_memory.MJCF)  # only a model from a file gets the overview camera
    return SHIPPED | {
        "02_own_loop": example("02_own_loop").SCENE,
        "04_own_task": example("04_own_task").SCENE,
        "14_images": example("14_images").SCENE,
        "12_model_in_memory": {"model": str(folder / "model.xml"), "objects": in_memory.OBJECTS},
        "18_variants": example("18_variants").SCENE,
        "13_own_mesh": own_mesh.scene(folder / "wedge.xml"),
        "16_randomised_task": example("16_randomised_task").SCENE,
        "17_randomised_loop": {"model": str(folder / "ground.xml"), "objects": loop.OBJECTS},
        "21_adr": {"model": str(folder / "cube.xml"), "objects": adr.OBJECTS},
    }


def main() -> None:
    """Draw the pictures, with separate seeds for each example."""
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        found = scenes(Path(folder))
        for i, path in enumerate(EXAMPLES):
            name = Path(path).stem
            sheet = grid(list(worlds_of(compile_scene(found[name], "cpu"), _COLUMNS, _COLUMNS * i)), _COLUMNS, 4)
            sheet.save(FOLDER / f"{name}.jpg", quality=85, optimize=True)


if __name__ == "__main__":
    main()

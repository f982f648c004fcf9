"""Pictures of worlds from their cameras: of four scenes for the README, and with randomised appearance.

python -m docs.make_worlds   # about three minutes
"""

from __future__ import annotations

import runpy
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from sceniris_gym import CompiledScene, ResetRandomizer, compile_scene, make_worlds
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot

PICTURE = Path(__file__).parent / "worlds.jpg"
KITCHENS = PICTURE.with_name("kitchens.jpg")
"""The second picture of the README: worlds of the scene `kitchen_any`, whose furniture differs."""
RANDOMISED = PICTURE.with_name("randomised.jpg")
"""The picture of docs/randomisation.md: worlds with randomised physics and appearance."""
SCENES = ("clutter", "kitchen", "dinner")
SIZE = (200, 150)
"""Pixels of a world in a small picture."""
LARGE = (480, 360)
"""Pixels of a world in the picture of the README."""
KITCHEN = (360, 200)
"""Pixels of a kitchen."""
PAPER = (255, 255, 255)
_WORLDS = 3
_DRAWN = 3  # pixels are drawn at this multiple of a picture's size, and scaled down
_GAP = 6


def worlds_of(
    compiled: CompiledScene, worlds: int, seed: int = 0, size: tuple[int, int] = SIZE, camera: str = "overview"
) -> np.ndarray:
    """Return pictures of worlds of a scene, with seeds from `seed` on, (worlds, height, width, 3) uint8.

    They are three times as large as `size`, and `grid` scales them down.
    """
    model, data = make_worlds(compiled, worlds, nconmax=1, njmax=1)
    ResetRandomizer(compiled, model, data, seed=seed).reset()
    width, height = (_DRAWN * edge for edge in size)
    cameras = Cameras(compiled.scene.sim, model, data, {camera: Shot((width, height))}, Looks(shadows=True))
    cameras.launch()
    return cameras.images[camera]["rgb"].numpy()


def grid(pictures: Sequence[np.ndarray], columns: int, gap: int, size: tuple[int, int] = SIZE) -> Image.Image:
    """Return pictures, scaled to `size`, in rows with gaps of `gap` pixels."""
    width, height = size[0] + gap, size[1] + gap
    sheet = Image.new("RGB", (columns * width - gap, -(-len(pictures) // columns) * height - gap), PAPER)
    for i, picture in enumerate(pictures):
        small = Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS)
        sheet.paste(small, (i % columns * width, i // columns * height))
    return sheet


def main() -> None:
    """Draw the pictures."""
    task = runpy.run_path(str(PICTURE.parents[1] / "examples" / "16_randomised_task.py"))
    grid(list(worlds_of(compile_scene(task["SCENE"], "cpu"), 16)), 4, 4).save(RANDOMISED, quality=85, optimize=True)
    tiles = [tile for scene in SCENES for tile in worlds_of(compile_scene(scene, "cpu"), _WORLDS, size=LARGE)]
    grid(tiles, _WORLDS, _GAP, LARGE).save(PICTURE, quality=88, optimize=True)
    kitchens = worlds_of(compile_scene("kitchen_any", "cpu"), 16, size=KITCHEN, camera="row")
    grid(list(kitchens), 4, _GAP, KITCHEN).save(KITCHENS, quality=85, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()

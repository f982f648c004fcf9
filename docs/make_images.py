"""The pictures of docs/images.md: views of the same worlds from two cameras, and variants of small pictures.

python -m docs.make_images   # about a minute
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image

from sceniris_gym import SceneVectorEnv

FOLDER = Path(__file__).parent
TASK = "sceniris_gym.envs.tabletop_reach_pixels:TabletopReachPixels"
_WORLDS, _PIXELS, _GAP = 5, 144, 4
_LOOKS = ({}, {"shadows": True}, {"thin": True})
_NEAR, _FAR = 0.4, 2.2  # m, from light to dark in pictures of depth
_PALETTE = "tab10"


def pictures(images: dict[str, dict], seed: int = 0) -> dict[str, dict[str, np.ndarray]]:
    """Return pictures of some worlds of TabletopReachPixels-v0 by camera and kind."""
    envs = SceneVectorEnv(TASK, _WORLDS, device="cpu", output="numpy", images=images)
    return envs.reset(seed=seed)[0]["images"]


def as_colours(kind: str, values: np.ndarray) -> np.ndarray:
    """Return pictures of any kind as colours, (worlds, height, width, 3) uint8."""
    if kind == "rgb":
        return values
    if kind == "depth":
        grey = np.where(values > 0.0, 1.0 - (values - _NEAR) / (_FAR - _NEAR), 0.0)
        return np.repeat((255 * grey.clip(0.0, 1.0)).astype(np.uint8), 3, axis=3)
    # pyrefly: ignore[missing-attribute]
    colours = (255 * np.array(matplotlib.colormaps[_PALETTE].colors)).astype(np.uint8)
    colours[0] = 245  # the background
    return colours[values[..., 0]]


def sheet(rows: Sequence[np.ndarray], scale: int = 1) -> Image.Image:
    """Return rows of pictures with gaps between them, with pixels enlarged by `scale`."""
    height, width = (scale * n for n in rows[0].shape[1:3])
    drawn = Image.new("RGB", (len(rows[0]) * (width + _GAP) - _GAP, len(rows) * (height + _GAP) - _GAP), "white")
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            large = Image.fromarray(picture).resize((width, height), Image.Resampling.NEAREST)
            drawn.paste(large, (x * (width + _GAP), y * (height + _GAP)))
    return drawn


def main() -> None:
    """Draw both pictures."""
    size = (_PIXELS, _PIXELS)
    seen = pictures({"front": {"size": size, "data": ("rgb", "depth", "segmentation")}, "wrist": {"size": size}})
    rows = [as_colours(kind, values) for of_camera in seen.values() for kind, values in of_camera.items()]
    sheet(rows).save(FOLDER / "images.jpg", quality=88, optimize=True)
    small = [pictures({"front": {"size": (64, 64), **looks}})["front"]["rgb"] for looks in _LOOKS]
    sheet(small, 2).save(FOLDER / "images_looks.png", optimize=True)


if __name__ == "__main__":
    main()

"""Draws the picture at the head of the README: worlds of three scenes, as their cameras see them.

python -m docs.make_worlds   # about a minute
"""

from __future__ import annotations

from pathlib import Path

import mujoco_warp as mjw
import numpy as np
import warp as wp
from PIL import Image, ImageDraw, ImageFont

from sceniris_gym import CompiledScene, LayoutGenerator, compile_scene
from sceniris_gym.pictures.camera import FrameCamera

PICTURE = Path(__file__).parent / "worlds.jpg"
SCENES = ("clutter", "kitchen", "mid")
_ROWS = _COLUMNS = 3
_SIZE = (200, 150)  # pixels of a world
_DRAWN = 3  # times as large as it is shown
_GAP, _BETWEEN, _STRIP = 4, 16, 24
_INK, _PAPER = (40, 44, 50), (255, 255, 255)


def worlds_of(compiled: CompiledScene) -> np.ndarray:
    """Return pictures of the first worlds of a scene, seeds from 0 on, (n, height, width, 3) uint8."""
    num = _ROWS * _COLUMNS
    generator = LayoutGenerator(compiled, num, seed=0)
    generator.generate()
    model, data = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, num, nconmax=1, njmax=1)
    layouts = generator.layouts
    wp.copy(data.qpos, layouts.qpos)
    if compiled.mjm.nmocap:
        data.mocap_pos.assign(layouts.mocap_pos.numpy())
        data.mocap_quat.assign(layouts.mocap_quat.numpy())
    width, height = (_DRAWN * edge for edge in _SIZE)
    return FrameCamera(compiled.mjm, model, num, width, height).take(data)


def main() -> None:
    """Draw the picture."""
    cell = np.array(_SIZE) + _GAP
    panel = cell * [_COLUMNS, _ROWS] - _GAP
    sheet = Image.new("RGB", (len(SCENES) * (panel[0] + _BETWEEN) - _BETWEEN, panel[1] + _STRIP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=15)
    for number, scene in enumerate(SCENES):
        left = number * (panel[0] + _BETWEEN)
        for i, picture in enumerate(worlds_of(compile_scene(scene, "cpu"))):
            small = Image.fromarray(picture).resize(_SIZE, Image.Resampling.LANCZOS)
            sheet.paste(small, (int(left + cell[0] * (i % _COLUMNS)), int(cell[1] * (i // _COLUMNS))))
        draw.text((left, panel[1] + 4), scene, _INK, font)
    sheet.save(PICTURE, quality=90, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()

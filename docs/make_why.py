"""The picture of docs/why.md: resets without checks and with them, for the same seeds. Overlapping objects are red.

python -m docs.make_why   # about a minute
"""

from __future__ import annotations

import copy
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from docs.make_worlds import PAPER
from sceniris_gym import CompiledScene, LayoutGenerator, compile_scene
from sceniris_gym.pictures.layout_picture import render
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.training.layout_sources import unchecked

PICTURE = Path(__file__).parent / "why.jpg"
_SCENE = "clutter"
_ROWS = ("objects placed without checks", "sceniris_gym, the same seeds")
_WORLDS, _SIZE, _GAP, _STRIP = 4, (420, 315), 6, 32
_DEPTH = 1e-4  # m, a deeper contact is an overlap, as in benchmarks/playground_overlaps.py
_RED, _INK = (0.86, 0.12, 0.1, 1.0), (40, 44, 50)


def overlapping(compiled: CompiledScene, table: LayoutTable, row: int) -> set[int]:
    """Return the ids of the bodies that are in a contact deeper than 0.1 mm, by MuJoCo C."""
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    table.put(data, row)
    mujoco.mj_fwdPosition(mjm, data)
    deep = [contact.geom for contact in data.contact if contact.dist < -_DEPTH]
    return {int(mjm.geom_bodyid[geom]) for pair in deep for geom in pair}


def in_red(mjm: mujoco.MjModel, bodies: set[int]) -> mujoco.MjModel:
    """Return a copy of the model with red bodies."""
    painted = copy.copy(mjm)
    geoms = np.isin(mjm.geom_bodyid, [*bodies])
    painted.geom_matid[geoms], painted.geom_rgba[geoms] = -1, _RED
    return painted


def main() -> None:
    """Draw the picture, and print the number of worlds with an overlap in each row."""
    compiled = compile_scene(_SCENE, "cpu")
    height, step = _SIZE[1], _SIZE[0] + _GAP
    sheet = Image.new("RGB", (_WORLDS * step - _GAP, len(_ROWS) * (height + _STRIP)), PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=20)
    for row, (text, source) in enumerate(zip(_ROWS, (unchecked(compiled), compiled), strict=True)):
        generator = LayoutGenerator(source, _WORLDS, seed=0)
        generator.generate()
        table = generator.table()
        bodies = [overlapping(compiled, table, i) for i in range(_WORLDS)]
        top = row * (height + _STRIP)
        draw.text((0, top + 4), text, _INK, font)
        for i in range(_WORLDS):
            picture = render(in_red(compiled.mjm, bodies[i]), table[i : i + 1], size=_SIZE, device="cpu")[0]
            sheet.paste(Image.fromarray(picture), (i * step, top + _STRIP))
        print(f"{text}: overlaps in {sum(map(bool, bodies))} of {_WORLDS} worlds", flush=True)
    sheet.save(PICTURE, quality=88, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()

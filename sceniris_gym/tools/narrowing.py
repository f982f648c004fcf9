"""How much `reachable` narrows where objects lie: a scene with it and without, as numbers and seen from above."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.build import build_world
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.scene.config import SceneConfig
from sceniris_gym.scene.values import ROBOT
from sceniris_gym.scene.world import World
from sceniris_gym.tools.dataset import LayoutTable, read_table
from sceniris_gym.tools.render import save

CELL = 0.04
"""Edge [m] of the cells by which the area is measured in which an object lies."""
_SCALE = 320  # pixels a metre, as far as a panel is no larger than _PANEL
_PANEL = 620
_GAP, _STRIP = 12, 26
_INK, _PAPER, _PALE, _ARM = (40, 44, 50), (255, 255, 255), (226, 229, 233), (90, 96, 104)
_COLOURS = ((214, 96, 36), (38, 110, 184), (62, 140, 74), (150, 78, 158), (186, 148, 24), (30, 150, 150))


@dataclass(frozen=True)
class Narrowing:
    """Where the objects that are to be reachable lie without that word and with it.

    Attributes:
        before: object name -> positions [m] in the world where it is present, shape (n, 2), without `reachable`.
        after: the same with it.
        rejections: rejections per object and cause, with it.
        base: position [m] and heading [rad] of the robot's base, shape (3,).
        lower: corner of all that is drawn [m], shape (2,).
        upper: the corner opposite.
    """

    before: Mapping[str, np.ndarray]
    after: Mapping[str, np.ndarray]
    rejections: Mapping[str, Mapping[str, int]]
    base: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def figures(self) -> dict[str, dict[str, float | int]]:
        """Areas [m2] in which each object lies, before and after, the share that is kept, and what was rejected why.

        An area is that of the cells of CELL x CELL with a position in them, so it needs a few layouts a cell.
        """
        found = {}
        for name in self.after:
            before, after = _area(self.before[name]), _area(self.after[name])
            reasons = ("unreachable", "no_ik", "blocked")
            found[name] = {
                "area_before_m2": round(before, 4),
                "area_after_m2": round(after, 4),
                "kept": round(after / before, 4) if before > 0.0 else 1.0,
                **{reason: self.rejections[name][reason] for reason in reasons},
            }
        return found


def narrow(world: World, layouts: int, seed: int, path: Path | None = None) -> dict:
    """Return what the commands tell: `narrowing`, and `picture` where one was drawn; nothing without `reachable`.

    Args:
        world: the scene.
        layouts: how many to make with `reachable`, and how many without.
        seed: seed of the first one.
        path: where the picture goes, None for none.

    Raises:
        SceneKeyError: a picture is asked for of a scene in which nothing is to be reachable.
    """
    if world.reaching is None:
        if path is not None:
            raise SceneKeyError(
                f"{world.config.where}: --picture shows what 'reachable' does, and no object has it. "
                "Add it, as in --set objects.apple.reachable=map, or leave out --picture."
            )
        return {}
    found = narrowing(world, layouts, seed)
    if path is None:
        return {"narrowing": found.figures()}
    save(picture(found, world.config.name), path)
    return {"narrowing": found.figures(), "picture": str(path)}


def narrowing(world: World, layouts: int, seed: int) -> Narrowing:
    """Make layouts of a scene as it is, and of the same scene without `reachable`.

    Args:
        world: the scene.
        layouts: how many of each.
        seed: seed of the first one.
    """
    names = () if world.reaching is None else world.reaching.names
    changes = {f"objects.{name}.reachable": False for name in names}
    plain = build_world(SceneConfig.load(world.config, changes), world.device) if names else world
    tables, counts = [], []
    for each in (plain, world):
        generator = LayoutGenerator(each, layouts, seed=seed)
        generator.generate()
        tables.append(read_table(generator))
        counts.append(generator.rejection_counts())
    before, after = ({name: _positions(world, table, name) for name in names} for table in tables)
    base = world.plan.place[world.slots.index(ROBOT)][[0, 1, 3]] if ROBOT in world.slots else np.zeros(3)
    lower, upper = _frame(world, [*before.values(), *after.values(), base[None, :2]])
    return Narrowing(before, after, counts[1], base, lower, upper)


def picture(found: Narrowing, title: str) -> Image.Image:
    """Draw where objects lie from above: without `reachable` on the left, with it on the right; x is to the right."""
    size = found.upper - found.lower
    scale = min(_SCALE, _PANEL / float(size.max()))
    width, height = (int(np.ceil(scale * edge)) for edge in size)
    sheet = Image.new("RGB", (2 * width + 3 * _GAP, height + 2 * _STRIP + _GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=14)
    for i, (words, positions) in enumerate((("without reachable", found.before), ("with it", found.after))):
        left, top = _GAP + i * (width + _GAP), _STRIP
        draw.rectangle((left, top, left + width, top + height), fill=(246, 247, 249), outline=_PALE)
        draw.text((left + 2, 4), f"{title}: {words}" if i == 0 else words, _INK, font)
        origin = np.array([left - scale * found.lower[0], top + height + scale * found.lower[1]])
        for k, name in enumerate(positions):
            for x, y in positions[name]:
                px, py = origin[0] + scale * x, origin[1] - scale * y
                draw.ellipse((px - 1.5, py - 1.5, px + 1.5, py + 1.5), fill=_COLOURS[k % len(_COLOURS)])
        _draw_base(draw, origin, scale, found.base)
    x = float(_GAP)
    for k, (name, part) in enumerate(found.figures().items()):
        text = f"{name}: {part['area_before_m2']:.2f} to {part['area_after_m2']:.2f} m2"
        draw.text((x, height + _STRIP + 4), text, _COLOURS[k % len(_COLOURS)], font)
        x += draw.textlength(text, font) + 2 * _GAP
    return sheet


def _draw_base(draw: ImageDraw.ImageDraw, origin: np.ndarray, scale: float, base: np.ndarray) -> None:
    """A disc at the robot's base, and a tick where its x axis points."""
    x, y = origin[0] + scale * base[0], origin[1] - scale * base[1]
    tip = (x + 18 * np.cos(base[2]), y - 18 * np.sin(base[2]))
    draw.ellipse((x - 7, y - 7, x + 7, y + 7), fill=_ARM)
    draw.line((x, y, *tip), fill=_ARM, width=3)


def _positions(world: World, table: LayoutTable, name: str) -> np.ndarray:
    """Positions of an object's root [m] in the layouts in which it is present, shape (n, 2)."""
    mjm, body = world.mjm, world.scene.bodies[name]
    there = table.present[:, world.slots.index(name)] & table.valid
    mocap = int(mjm.body_mocapid[body])
    if mocap >= 0:
        return table.mocap_pos[there, mocap, :2]
    joint = int(mjm.body_jntadr[body])
    assert mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
    adr = int(mjm.jnt_qposadr[joint])
    return table.qpos[there, adr : adr + 2]


def _area(positions: np.ndarray) -> float:
    return len(np.unique(np.floor(positions / CELL).astype(int), axis=0)) * CELL**2


def _frame(world: World, points: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The least rectangle around points and the floor, and a margin."""
    every = np.concatenate(points)
    if world.config.floor is not None:
        half = 0.5 * np.array(world.config.floor.size)
        every = np.concatenate([every, [-half, half]])
    return every.min(axis=0) - 0.05, every.max(axis=0) + 0.05

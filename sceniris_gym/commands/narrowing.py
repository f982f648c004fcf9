"""The effect of `reachable` on the places of objects: compares a scene with and without it, in numbers and a picture.

For a scene without `reachable`, the picture shows only the places of its objects.

The fraction of candidates that `reachable` keeps is measured in layouts made without `reachable`: it is the fraction of
layouts in which the arm's map accepts a grasp of the object. The tiers `ik` and `clear` test a layout after all objects
are placed. For these tiers, the fraction is multiplied by the fraction of the object's tests that succeeded.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sceniris_gym.config.member_names import without_support
from sceniris_gym.geometry.rotations import matrix, pose_matrix
from sceniris_gym.grasping.grasps import MOST_RISING
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.pictures.layout_picture import save
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.poses import body_poses

_REASONS = ("unreachable", "no_ik", "blocked", "no_path")
_SCALE = 320  # pixels per metre, less if a panel would be larger than _PANEL
_PANEL = 620
_GAP, _STRIP = 12, 26
_INK, _PAPER, _PALE, _ARM = (40, 44, 50), (255, 255, 255), (226, 229, 233), (90, 96, 104)
_COLOURS = ((214, 96, 36), (38, 110, 184), (62, 140, 74), (150, 78, 158), (186, 148, 24), (30, 150, 150))


class Narrowing(NamedTuple):
    """Positions of the objects that should be reachable, with and without `reachable`.

    Attributes:
        before: Object name -> world positions [m], shape (n, 2), in the layouts that are made without `reachable` and
            contain the object. Empty for a scene without `reachable`.
        after: The same with `reachable`. For a scene without `reachable`, positions of all placed objects.
        figures: Object name -> the fraction of its candidates that `reachable` accepts, the number of candidates, and
            its rejections by reach, per cause. Empty for a scene without `reachable`.
        bases: Position [m] and heading [rad] of the bases of robots that layouts do not place, shape (n, 3).
        lower, upper: Opposite corners of the picture [m], shape (2,).
    """

    before: Mapping[str, np.ndarray]
    after: Mapping[str, np.ndarray]
    figures: Mapping[str, Mapping[str, float]]
    bases: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def narrow(
    compiled: CompiledScene, layouts: int, seed: int, path: Path | None = None, made: LayoutGenerator | None = None
) -> dict:
    """Return entries for a command's output: `narrowing` if the scene has `reachable`, `picture` if `path` is given.

    Args:
        compiled: The compiled scene.
        layouts: Number of layouts to make with `reachable`, and again without.
        seed: Seed of the first layout.
        path: The file of the picture, or None.
        made: A generator of the compiled scene that has already made these layouts.
    """
    if path is None and compiled.reaching is None:
        return {}
    found = narrowing(compiled, layouts, seed, made)
    entries: dict[str, Any] = {} if compiled.reaching is None else {"narrowing": found.figures}
    if path is not None:
        save(picture(found, compiled.config.name), path)
        entries["picture"] = str(path)
    return entries


def narrowing(compiled: CompiledScene, layouts: int, seed: int, made: LayoutGenerator | None = None) -> Narrowing:
    """Compare layouts of a scene with the same number of layouts without `reachable`. See `narrow` for arguments."""
    generator = made or LayoutGenerator(compiled, layouts, seed=seed)
    if made is None:
        generator.generate()
    table, counts = generator.table(), generator.rejection_counts()
    before, figures = {}, {}
    names = [name for name in compiled.object_names if name in compiled.placed]
    if compiled.reaching is not None:
        names = compiled.reaching.names
        changes = {"start": [], **{f"objects.{without_support(name)}.reachable": False for name in names}}
        plain = compile_scene(compiled.config, compiled.device, overrides=changes)
        free, passed = make_table(plain, layouts, seed), _staged(compiled, table, counts)
        before = {name: _positions(compiled, free, name) for name in names}
        figures = {
            name: {
                "kept": round(passed[name] * _on_map(compiled, plain, free, name), 4),
                "candidates": len(before[name]),
                **{reason: counts[name][reason] for reason in _REASONS},
            }
            for name in names
        }
    after = {name: _positions(compiled, table, name) for name in names}
    still = [compiled.slots.index(name) for name in compiled.config.all_robots if name not in compiled.config.parts]
    bases, floor = compiled.plan.pivot_pose[still][:, [0, 1, 3]], compiled.config.floor
    corners = _corners([*before.values(), *after.values(), bases[:, :2]], None if floor is None else floor.size)
    return Narrowing(before, after, figures, bases, *corners)


def picture(found: Narrowing, title: str) -> Image.Image:
    """Draw the objects from above, with x to the right: without `reachable` on the left, with it on the right.

    For a scene without `reachable`, one panel shows all objects.
    """
    panels = {title: found.after}
    if found.before:
        panels = {f"{title}: without reachable": found.before, "with reachable": found.after}
    size = found.upper - found.lower
    scale = min(_SCALE, _PANEL / float(size.max()))
    width, height = (int(np.ceil(scale * edge)) for edge in size)
    wide, font = len(panels) * (width + _GAP) + _GAP, ImageFont.load_default(size=14)
    told = found.figures.items()
    texts = [f"{name}: {part['kept']:.0%} of {part['candidates']} are within reach" for name, part in told]
    places = _wrapped(texts or list(found.after), wide, font)
    lines = 1 + max((line for _, _, line in places), default=0)
    sheet = Image.new("RGB", (wide, height + (1 + lines) * _STRIP + _GAP), _PAPER)
    draw = ImageDraw.Draw(sheet)
    for i, (caption, positions) in enumerate(panels.items()):
        left, top = _GAP + i * (width + _GAP), _STRIP
        draw.rectangle((left, top, left + width, top + height), fill=(246, 247, 249), outline=_PALE)
        draw.text((left + 2, 4), caption, _INK, font)
        origin = np.array([left - scale * found.lower[0], top + height + scale * found.lower[1]])
        for k, name in enumerate(positions):
            for x, y in positions[name]:
                px, py = origin[0] + scale * x, origin[1] - scale * y
                draw.ellipse((px - 1.5, py - 1.5, px + 1.5, py + 1.5), fill=_COLOURS[k % len(_COLOURS)])
        for base in found.bases:
            x, y = origin[0] + scale * base[0], origin[1] - scale * base[1]
            draw.ellipse((x - 7, y - 7, x + 7, y + 7), fill=_ARM)
            draw.line((x, y, x + 18 * np.cos(base[2]), y - 18 * np.sin(base[2])), fill=_ARM, width=3)
    for k, (text, x, line) in enumerate(places):
        draw.text((x, height + (1 + line) * _STRIP + 4), text, _COLOURS[k % len(_COLOURS)], font)
    return sheet


def _wrapped(texts: list[str], wide: int, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> list[tuple]:
    """Arrange texts in lines that fit the width of the picture. Return each text with its x [pixels] and its line."""
    places, x, line = [], float(_GAP), 0
    for text in texts:
        length = font.getlength(text)
        if x > _GAP and x + length > wide:
            x, line = float(_GAP), line + 1
        places.append((text, x, line))
        x += length + 2 * _GAP
    return places


def _positions(compiled: CompiledScene, table: LayoutTable, name: str) -> np.ndarray:
    """Return the positions of an object's root [m] in the valid layouts with the object, shape (n, 2)."""
    there = table.present[:, compiled.slots.index(name)] & table.valid
    states = (column[there] for column in (table.qpos, table.mocap_pos, table.mocap_quat))
    return body_poses(compiled.mjm, compiled.scene.bodies[name], *states)[0][:, :2]


def _on_map(compiled: CompiledScene, plain: CompiledScene, table: LayoutTable, name: str) -> float:
    """Return the fraction of the layouts with an object in which the arm's map accepts a grasp of the object.

    `table` holds layouts of `plain`, the scene without `reachable`.
    """
    reaching, data = compiled.reaching, mujoco.MjData(plain.mjm)
    assert reaching is not None
    target = reaching.targets[reaching.names.index(name)]
    one = reaching.arm_of(target)
    placed = compiled.plan.objects[target.number]
    ups = np.array([matrix(v.quat)[2] for v in placed.stable_poses])  # world's z in the root's frame
    rows = np.flatnonzero(table.present[:, plain.slots.index(name)] & table.valid)
    poses, of = [], []
    for row in rows.tolist():
        table.put(data, row)
        mujoco.mj_kinematics(plain.mjm, data)
        root = _frame_of(data, plain.scene.bodies[name])
        first, number = target.grasp_set.spans[int((ups @ root[2, :3]).argmax())]
        base = np.linalg.inv(_frame_of(data, one.view.base_body))
        for grasp in target.grasp_set.grasps[first : first + number]:
            tcp = _frame_of(data, grasp.body) @ pose_matrix(grasp.pos, grasp.quat)
            if placed.ground is None or tcp[2, 2] <= MOST_RISING:
                poses.append(base @ tcp)
                of.append(row)
    if one.map is not None and poses:
        of = np.array(of)[one.map.verdict(np.stack(poses), compiled.device) >= target.tier.least_verdict]
    return len(np.unique(of)) / max(len(rows), 1)


def _staged(
    compiled: CompiledScene, table: LayoutTable, rejections: Mapping[str, Mapping[str, int]]
) -> dict[str, float]:
    """Return for each object the fraction of its tests by `ik` or `clear` that succeeded.

    A layout is tested after all objects are placed: object by object, until the first failure. A failure at one object
    therefore means that the tests of all earlier objects succeeded.
    """
    assert compiled.reaching is not None
    shares, later = {}, 0
    for name in reversed(compiled.reaching.names):
        failed = sum(rejections[name][cause] for cause in _REASONS[1:])
        passed = later + int((table.present[:, compiled.slots.index(name)] & table.valid).sum())
        shares[name] = passed / max(passed + failed, 1)
        later += failed
    return shares


def _frame_of(data: mujoco.MjData, body: int) -> np.ndarray:
    """Return the frame of a body in the world, shape (4, 4)."""
    return pose_matrix(data.xpos[body], data.xquat[body])


def _corners(points: list[np.ndarray], floor: Sequence[float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the smallest rectangle around points and the floor, plus a margin."""
    ends = [] if floor is None else [0.5 * np.outer([-1.0, 1.0], floor)]
    every = np.concatenate([*points, *ends])
    every = every if len(every) else np.zeros((1, 2))  # no valid layout, no robot and no floor
    return every.min(axis=0) - 0.05, every.max(axis=0) + 0.05

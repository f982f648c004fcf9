"""Kitchen furniture with drawn sizes: base units of one height that join into a row, counters and wall units.

Ranges of sizes are those of kitchens that shops sell: widths in steps of 5 or 10 cm, boards of 16 mm, fronts of 18 mm.
"""

import json
from collections.abc import Sequence
from numbers import Integral, Real
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, TypeVar

from sceniris_gym.builders.unit import Handle, Hinge, Point, Unit
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, refuses_old_names
from sceniris_gym.files import write_text

T = TypeVar("T")
MANIFEST = "manifest.json"
BOARD, FRONT, BACK, TOP, DRAWER, BASIN = 0.016, 0.018, 0.008, 0.04, 0.012, 0.004
"""Thicknesses [m] of boards, fronts, back walls, worktops, drawers and basins."""
GAP, OVERHANG, DEPTH, REAR = 0.003, 0.02, 0.6, 0.06
"""Gaps around fronts, overhang of worktops over fronts, depth of base units, and of the strip behind a lid [m]."""
TURN, SHORT = 0.7, 0.09
"""Upper limit of the joint of a turning handle [rad], and the length of its bar [m]."""
WIDTHS = (0.3, 0.4, 0.45, 0.5, 0.6, 0.8, 0.9)
"""Widths of base units and wall units [m]."""
WALL = ((0.32, 0.36), (0.35, 0.4), (0.32, 0.6), (0.35, 0.7), (0.37, 0.9))
"""Depths and heights of wall units [m]."""
COLOURS = {
    "front": "ebebe3 d9ccb3 879c8a 384a63 b38759 595c61",
    "body": "e0ded6 bd996e 9e9e9c",
    "worktop": "996b42 333336 d6d4cc 807d78",
    "plinth": "404042 666666",
    "metal": "b8babf b38f4d 1f1f21",
}
"""The colours of each material, in hexadecimal digits."""


class Draws:
    """Draws that depend only on their key. `Random.random` gives the same numbers in all versions of Python."""

    def __init__(self, key: str) -> None:
        self._next = Random(key).random

    def pick(self, choices: Sequence[T]) -> T:
        """Return one of some choices."""
        return choices[int(self._next() * len(choices))]

    def between(self, low: float, high: float) -> float:
        """Return a length [m] in full millimetres, or an angle [rad]."""
        return round(low + (high - low) * self._next(), 3)


class Area(NamedTuple):
    """A rectangle of fronts with the space behind it, in the unit's frame [m].

    Attributes:
        left: Left edge of the fronts.
        right: Right edge of the fronts.
        low: Lower edge of the fronts.
        high: Upper edge of the fronts.
        y: The plane of the fronts.
        inner: Left and right wall of the space behind.
        back: The plane at which the space behind ends.
    """

    left: float
    right: float
    low: float
    high: float
    y: float
    inner: tuple[float, float]
    back: float


class Builder:
    """Adds boards and fronts to one unit, whose look it draws.

    Attributes:
        size: Width, depth and height of the closed unit without handles [m].
        wall: Whether the unit hangs on a wall. Its fronts are then between its boards, and their handles are low.
        angles: Range of the upper limits of doors and flaps [rad].
        foot: Height of the plinth [m].
        turning: Whether the handles of doors and flaps turn.
    """

    def __init__(self, name: str, draws: Draws, height: float, turning: bool = False) -> None:
        self.turning, self.draws, self.wall, self.angles = turning, draws, False, (1.5, 1.75)
        self.unit = Unit(name, {material: draws.pick(colours.split()) for material, colours in COLOURS.items()})
        self.root, self.foot = self.unit.root, draws.pick((0.08, 0.10, 0.12, 0.15))
        self.size: Point = (draws.pick(WIDTHS), DEPTH, height)
        shape, thickness = draws.pick((("bar", 0.012), ("rod", 0.012), ("rod", 0.014), ("knob", 0.026)))
        self.handle = Handle(shape, thickness, draws.between(0.036, 0.045), draws.pick((0.128, 0.16, 0.192, 0.32)))

    def across(self, name: str, y: tuple[float, float], z: tuple[float, float], *look: str) -> None:
        """Add a box over the whole width to the root, between two y and two z [m]."""
        x = self.size[0] / 2
        self.root.box(name, (-x, y[0], z[0]), (x, y[1], z[1]), *look)

    def case(self, name: str, left: float, right: float, low: float, high: float, floor: float) -> Area:
        """Add side walls, bottom and back of a case, and its top if it is on a wall. Return its area for fronts.

        Args:
            name: Prefix of the boards' names.
            left: Left end [m].
            right: Right end [m].
            low: Lower end [m].
            high: Upper end [m].
            floor: Height of the bottom [m].
        """
        box, back, front = self.root.box, self.size[1] / 2, (0.0 if self.wall else OVERHANG) - self.size[1] / 2
        y, x0, x1 = front if self.wall else front + FRONT + 0.002, left + BOARD, right - BOARD
        box(f"{name}left", (left, y, low), (x0, back, high))
        box(f"{name}right", (x1, y, low), (right, back, high))
        box(f"{name}bottom", (x0, y, floor), (x1, back, floor + BOARD))
        box(f"{name}back", (x0, back - BACK, floor + BOARD), (x1, back, high - BOARD * self.wall))
        if not self.wall:
            return Area(left + GAP / 2, right - GAP / 2, low, high - GAP, front, (x0, x1), back - BACK)
        box(f"{name}top", (x0, y, high - BOARD), (x1, back, high))
        return Area(x0 + GAP, x1 - GAP, low + BOARD + GAP, high - BOARD - GAP, front, (x0, x1), back - BACK)

    def boards(self, area: Area, count: int) -> None:
        """Add shelf boards at equal distances."""
        for i in range(count):
            z = round(area.low + (area.high - area.low) * (i + 1) / (count + 1), 3)
            low, high = (area.inner[0], area.y + FRONT + 0.02, z), (area.inner[1], area.back, z + BOARD)
            self.root.box(f"board_{i}", low, high)

    def drawers(self, area: Area, shares: Sequence[float]) -> None:
        """Fill an area with drawers from the top down, whose heights have the given proportions."""
        top, room, travel = area.high, area.high - area.low + GAP, self.draws.between(0.30, 0.42)
        for share in shares:
            low = round(top - room * share / sum(shares) + GAP, 4)
            self._drawer(area._replace(low=low, high=top), travel)
            top = low - GAP

    def _drawer(self, area: Area, travel: float) -> None:
        left, right, low, high, y, inner, back = area
        part = self.unit.opening(self.next_front(), ((left + right) / 2, y, low), "drawer", travel)
        part.box(f"{part.name}_front", (left, y, low), (right, y + FRONT, high), "front")
        floor = low + BOARD + 0.01
        rim = min(high - 0.03, floor + self.draws.pick((0.10, 0.16, 0.22)))
        part.tray((inner[0] + 0.013, y + FRONT, floor), (inner[1] - 0.013, back - 0.03, rim), DRAWER)
        part.handle(self.fitted(right - left), (left + right) / 2, y, (low + high) / 2)

    def door(self, area: Area, hinge: Hinge) -> None:
        """Add a door, or a flap with its hinge at the top."""
        left, right, low, high, y, *_ = area
        origin, flap = (right if hinge == "right" else left, y, high), hinge == "top"
        angle, more = self.draws.between(*self.angles), {"gravcomp": 1} if flap else {}
        part = self.unit.opening(self.next_front(), origin, hinge, angle, **more)
        part.box(f"{part.name}_front", (left, y, low), (right, y + FRONT, high), "front")
        handle = self.fitted(right - left if flap else high - low)
        x = {"left": right - 0.04, "right": left + 0.04, "top": (left + right) / 2}[hinge]
        away = 0.05 if flap else 0.07 + handle.length / 2
        at = x, y, low + away if self.wall else high - away
        if self.turning:
            part = self.unit.opening(f"{part.name}_handle", at, "turn", TURN, parent=part, **more)
        part.handle(handle, *at, hinge)

    def doors(self, area: Area) -> None:
        """Fill an area with one door or, from a width of 0.55 m on, with two."""
        left, right, *_ = area
        if right - left < 0.55:
            return self.door(area, self.draws.pick(("left", "right")))
        self.door(area._replace(right=(left + right - GAP) / 2), "left")
        return self.door(area._replace(left=(left + right + GAP) / 2), "right")

    def next_front(self) -> str:
        """Return the name of the next front."""
        return f"front_{sum(not name.endswith('_handle') for name in self.unit.joints)}"

    def fitted(self, room: float) -> Handle:
        """Return the unit's handle for a front of the given length [m]. A turning handle does not pass the front."""
        return self.handle._replace(length=min(self.handle.length, room - 0.08, SHORT if self.turning else room))


def _base(builder: Builder) -> Area:
    """Add plinth, case and worktop of a base unit."""
    (width, depth, height), foot = builder.size, builder.foot
    builder.across("plinth", (0.07 - depth / 2, depth / 2), (0, foot), "plinth")
    builder.across("worktop", (-depth / 2, depth / 2), (height - TOP, height), "worktop", "slab")
    return builder.case("", -width / 2, width / 2, foot, height - TOP, foot)


def base_drawers(builder: Builder) -> None:
    """Build a base unit with two to four drawers."""
    shares = ((1, 1), (1, 1, 1), (1, 2, 2), (2, 3, 3), (1, 1, 2), (1, 1, 1, 1))
    builder.drawers(_base(builder), builder.draws.pick(shares))


def base_doors(builder: Builder) -> None:
    """Build a base unit with up to two boards behind one or two doors."""
    area = _base(builder)
    builder.boards(area, builder.draws.pick((0, 1, 1, 2)))
    builder.doors(area)


def base_shelves(builder: Builder) -> None:
    """Build a base unit that is open at the front."""
    builder.boards(_base(builder), builder.draws.pick((1, 2, 2, 3)))


def base_lid(builder: Builder) -> None:
    """Build a chest with a fixed front, below a lid that is level with the worktops next to it."""
    (width, depth, height), draws, foot = builder.size, builder.draws, builder.foot
    x, y, top = width / 2, depth / 2, height - TOP
    builder.across("plinth", (0.07 - y, y), (0, foot), "plinth")
    builder.across("front", (-y, OVERHANG + FRONT + 0.002 - y), (foot, top), "front")
    builder.across("rear", (y - REAR, y), (top, height), "worktop")
    builder.case("", -x, x, foot, top, draws.between(0.35, 0.6))
    lid = builder.unit.opening("lid", (0, y - REAR - GAP, height), "top", draws.between(1.3, 1.5), gravcomp=1)
    lid.box("lid_board", (GAP - x, GAP - y, top + GAP), (x - GAP, y - REAR - GAP, height), "worktop")
    lid.handle(builder.fitted(width), 0, GAP - y, height - TOP / 2)


def counter(builder: Builder) -> None:
    """Build two or three cases below one worktop, with a sink above the doors of one case."""
    draws, height, foot = builder.draws, builder.size[2], builder.foot
    widths = [draws.pick((0.4, 0.5)) for _ in range(draws.pick((2, 3)))]
    sink = draws.pick(range(len(widths)))
    widths[sink] = draws.pick((0.6, 0.8))
    builder.size, builder.angles = (round(sum(widths), 3), DEPTH, height), (1.4, 1.5)  # so that open doors do not meet
    x, y, left = builder.size[0] / 2, DEPTH / 2, -builder.size[0] / 2
    middle = left + sum(widths[:sink]) + widths[sink] / 2
    half_x, half_y, floor = draws.between(0.2, 0.25), draws.between(0.17, 0.2), height - draws.between(0.15, 0.2)
    builder.across("plinth", (0.07 - y, y), (0, foot), "plinth")
    builder.across("worktop_near", (-y, -half_y), (height - TOP, height), "worktop", "slab")
    builder.across("worktop_far", (half_y, y), (height - TOP, height), "worktop", "slab")
    for side, x0, x1 in (("left", -x, middle - half_x), ("right", middle + half_x, x)):
        builder.root.box(f"worktop_{side}", (x0, -half_y, height - TOP), (x1, half_y, height), "worktop", "slab")
    basin = builder.unit.part("basin", (middle, 0, floor))
    basin.tray((middle - half_x, -half_y, floor), (middle + half_x, half_y, height), BASIN, "metal")
    for i, width in enumerate(widths):
        area = builder.case(f"case_{i}_", left, left + width, foot, height - TOP, foot)
        if i == sink or draws.pick((True, False)):
            builder.doors(area)
        else:
            builder.drawers(area, draws.pick(((1, 1), (1, 2, 2), (1, 1, 1))))
        left += width


def wall(builder: Builder) -> None:
    """Build a case for a wall: low ones have a flap, others doors."""
    width, (depth, height) = builder.size[0], builder.draws.pick(WALL)
    builder.size, builder.wall = (width, depth, height), True
    area = builder.case("", -width / 2, width / 2, 0, height, 0)
    builder.boards(area, round(height / 0.35) - 1)
    if height < 0.5:
        builder.door(area, "top")
    else:
        builder.doors(area)


KINDS = {kind.__name__: kind for kind in (base_drawers, base_doors, base_lid, base_shelves, counter, wall)}
"""The kinds of units, which take turns. Their names are the beginnings of the files' names."""


@refuses_old_names
def furniture(
    folder: str | Path, n: int = 64, seed: int = 0, height: float = 0.9, turning: bool = False
) -> dict[str, Any]:
    """Write n pieces of kitchen furniture as MJCF files, whose sizes, fronts, handles and colours are drawn.

    The kinds take turns: base units with drawers, doors, a lid or open shelves (`base_*.xml`), counters with a sink
    (`counter_*.xml`) and wall units (`wall_*.xml`). Unit i depends only on `seed`, i and `height`, so more units keep
    the first ones. A part on a joint has the joint's name: `lid`, or `front_0`, `front_1` and so on.

    Args:
        folder: The output folder. It gets `manifest.json` with all units, and a folder with the manifest of each unit.
        n: Number of units, at most 10,000.
        seed: Seed of all draws.
        height: Height [m] of the worktops of base units and counters, from 0.7 to 1.1.
        turning: Whether the handles of doors and flaps turn: `front_0_handle` is a hinge on `front_0`.

    Returns:
        The content of `manifest.json`: for each unit its file, kind, seed, size without handles [m], joints with their
        ranges [m or rad], parts and tags.

    Raises:
        ArgumentTypeError: An argument has another type or name.
        ArgumentError: A number is out of its range, or the folder has other MJCF files.
        OutputError: A file cannot be written.
    """
    for name, value, low, high in (("n", n, 1, 10_000), ("seed", seed, 0, 2**64 - 1), ("height", height, 0.7, 1.1)):
        kind, told = (Real, "a number") if name == "height" else (Integral, "an integer")
        if not isinstance(value, kind):
            raise ArgumentTypeError(f"furniture: {name} should be {told}, got {value!r}.")
        if not low <= value <= high:
            raise ArgumentError(f"furniture: {name} should be from {low} to {high}, got {value}.")
    folder, kinds = Path(folder), list(KINDS)
    names = [f"{kinds[i % len(kinds)]}_{i:04d}" for i in range(n)]
    others = sorted(path.name for path in folder.glob("*.xml") if path.stem not in names)
    if others:
        raise ArgumentError(f"furniture: {folder} has other files, such as {others[0]}. Give a new folder.")
    manifest = {"units": [_write(folder, name, int(seed), float(height), turning) for name in names]}
    write_text(folder / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    return manifest


def _write(folder: Path, name: str, seed: int, height: float, turning: bool) -> dict[str, Any]:
    """Write one unit, and its manifest into a folder of the same name, where the word `tags` finds it."""
    kind, i = name[:-5], int(name[-4:])
    builder = Builder(name, Draws(f"{seed}/{i}"), height, turning)
    KINDS[kind](builder)
    unit = builder.unit
    parts = unit.sort_parts()
    joints = {part: unit.joints[part] for part in parts if part in unit.joints}
    manifest = {"file": f"{name}.xml", "kind": kind, "seed": seed, "size": builder.size, "joints": joints}
    tags = [*kind.split("_"), *(["graspable", builder.handle.shape] if joints else ["rigid"])]
    manifest |= {"parts": parts, "tags": tags}
    write_text(folder / f"{name}.xml", unit.text())
    write_text(folder / name / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    return manifest
